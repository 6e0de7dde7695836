// Files in, registration out: the program is Rust in WebAssembly, and this hands it bytes.
(() => {
  const at = (id) => document.getElementById(id);
  const clouds = [
    { input: at('scan'), said: at('scan-read'), isRead: false },
    { input: at('part'), said: at('part-read'), isRead: false },
  ];
  let program = null;
  let stopViewing = null;

  function answer() {
    const { memory, answer, answer_length: length } = program;
    return JSON.parse(new TextDecoder().decode(new Uint8Array(memory.buffer, answer(), length())));
  }
  // What a call answers; what stops the program is an answer, too.
  function call(act) {
    try {
      act();
      return answer();
    } catch (error) {
      program = null;
      return { error: `the program stopped (${error.message}): load this page again, and try other files` };
    }
  }
  const ended = (text) => text + (/[.!?]$/.test(text) ? '' : '.');
  const sentence = (text) => ended(text.charAt(0).toUpperCase() + text.slice(1));

  async function read(which, file) {
    const cloud = clouds[which];
    cloud.isRead = false;
    at('result').hidden = true;
    const bytes = new Uint8Array(await file.arrayBuffer());
    const name = new TextEncoder().encode(file.name);
    const said = call(() => {
      const place = program.input(name.length + bytes.length);
      new Uint8Array(program.memory.buffer).set(name, place);
      new Uint8Array(program.memory.buffer).set(bytes, place + name.length);
      program.read(which, name.length);
    });
    cloud.isRead = !said.error;
    const faces = said.faces ? ` and ${said.faces} triangles` : '';
    cloud.said.textContent = said.error
      ? ended(said.error) // it begins with the file's name
      : [`${file.name}: ${said.points} points${faces}`, ...said.notes].map(ended).join(' ');
    cloud.said.className = said.error ? 'note' : 'help';
  }

  function register() {
    if (!clouds.every((cloud) => cloud.isRead)) {
      at('state').textContent = '';
      return;
    }
    const before = performance.now();
    const said = call(() => program.register(at('anywhere').checked ? 1 : 0));
    at('result').hidden = Boolean(said.error);
    if (said.error) {
      at('state').textContent = sentence(said.error);
      return;
    }
    const took = (performance.now() - before).toFixed(0);
    const { verdict, probability, overlap, target_from_source: rows } = said.document;
    // Nothing is certain: rounded down.
    const share = (x) => `${x > 0.99 ? Math.floor(1000 * x) / 10 : Math.floor(100 * x)} %`;
    at('state').textContent = `Verdict: ${verdict}. Right with a probability of ${share(probability)}; `
      + `${share(overlap)} of the scan lies on the part. It took ${took} ms.`;
    at('pose').textContent = [...rows, [0, 0, 0, 1]].map((row) => row.join(' ')).join('\n');
    at('copied').textContent = '';
    if (stopViewing) stopViewing();
    at('view').replaceChildren(at('viewer-template').content.cloneNode(true));
    stopViewing = view([said.view]);
  }

  async function take(files) {
    for (const [which, file] of files) await read(which, file);
    register();
  }
  clouds.forEach(({ input }, which) => {
    input.addEventListener('change', () => input.files[0] && take([[which, input.files[0]]]));
    const label = input.closest('label');
    label.addEventListener('dragover', () => label.classList.add('over'));
    label.addEventListener('dragleave', () => label.classList.remove('over'));
    label.addEventListener('drop', (event) => {
      event.preventDefault();
      event.stopPropagation();
      label.classList.remove('over');
      if (event.dataTransfer.files[0]) take([[which, event.dataTransfer.files[0]]]);
    });
  });
  // Elsewhere on the page: two files are the scan and the part, one is what is missing.
  document.addEventListener('dragover', (event) => event.preventDefault());
  document.addEventListener('drop', (event) => {
    event.preventDefault();
    const [first, second] = event.dataTransfer.files;
    if (second) take([[0, first], [1, second]]);
    else if (first) take([[clouds[0].isRead ? 1 : 0, first]]);
  });
  at('anywhere').addEventListener('change', register);
  at('copy').addEventListener('click', async () => {
    try {
      await navigator.clipboard.writeText(at('pose').textContent);
      at('copied').textContent = 'Copied.';
    } catch {
      getSelection().selectAllChildren(at('pose'));
      at('copied').textContent = 'Selected: copy it with the keyboard.';
    }
  });

  const bytes = Uint8Array.from(atob(at('program').textContent), (c) => c.charCodeAt(0));
  WebAssembly.instantiate(bytes).then(({ instance }) => {
    program = instance.exports;
    document.body.dataset.ready = 'yes';
  }, () => {
    at('state').textContent = 'This browser does not run WebAssembly with vectors: take one of 2023 or later.';
  });
})();
