// Files in, registration out: the program is Rust in WebAssembly, and this hands it bytes.
(() => {
  const at = (id) => document.getElementById(id);
  const clouds = ['scan', 'part'].map((name) => ({
    input: at(name), said: at(`${name}-read`), file: null, isRead: false,
  }));
  let compiled = null;
  let program = null;
  let stopViewing = null;

  const ended = (text) => text + (/[.!?]$/.test(text) ? '' : '.');
  const sentence = (text) => ended(text.charAt(0).toUpperCase() + text.slice(1));
  const matrix = (rows) => [...rows, [0, 0, 0, 1]].map((row) => row.join(' ')).join('\n');

  async function start() {
    program = (await WebAssembly.instantiate(compiled)).exports;
    for (const cloud of clouds) cloud.isRead = false;
  }
  // Addresses are unsigned.
  function answer() {
    const bytes = new Uint8Array(program.memory.buffer, program.answer() >>> 0, program.answer_length() >>> 0);
    return JSON.parse(new TextDecoder().decode(bytes));
  }
  // What a call answers. A program that stopped is not called again: another takes its place.
  async function call(what, act) {
    try {
      act();
      return answer();
    } catch {
      program = null;
      await start();
      return { error: `The program stopped while it ${what}, probably for want of memory, and was started again: try smaller files` };
    }
  }

  async function read(which, file) {
    const { name } = file;
    let bytes;
    try {
      bytes = new Uint8Array(await file.arrayBuffer());
    } catch {
      return { error: `${name} cannot be read: it is a folder, too large, or no longer there as it was` };
    }
    const path = new TextEncoder().encode(name);
    return call(`read ${name}`, () => {
      const place = program.input(path.length + bytes.length) >>> 0;
      new Uint8Array(program.memory.buffer).set(path, place);
      new Uint8Array(program.memory.buffer).set(bytes, place + path.length);
      program.read(which, path.length);
    });
  }
  async function readAndTell(cloud) {
    const { file, file: { name } } = cloud;
    const said = await read(clouds.indexOf(cloud), file);
    if (cloud.file !== file) return; // another was chosen meanwhile, and is read next
    cloud.isRead = !said.error;
    if (said.error) cloud.file = null;
    const faces = said.faces ? ` and ${said.faces} triangles` : '';
    cloud.said.textContent = said.error
      ? ended(said.error) // it begins with the file's name
      : [`${name}: ${said.points} points${faces}`, ...said.notes].map(ended).join(' ');
    cloud.said.className = said.error ? 'note' : 'help';
  }

  async function register() {
    const anywhere = at('anywhere').checked ? 1 : 0;
    const before = performance.now();
    const said = await call('registered', () => program.register(anywhere));
    if (said.error) {
      at('state').textContent = sentence(said.error);
      return;
    }
    const took = (performance.now() - before).toFixed(0);
    const { verdict, target_from_source: pose, undetermined } = said.document;
    at('state').textContent = `Verdict: ${verdict}. It took ${took} ms.`;
    const items = said.sentences.map((text) => {
      const item = document.createElement('li');
      item.textContent = sentence(text);
      return item;
    });
    at('sentences').replaceChildren(...items);
    at('pose').textContent = matrix(pose);
    at('copied').textContent = '';
    at('others').hidden = undetermined.poses.length === 0;
    at('other-poses').textContent = undetermined.poses.map(matrix).join('\n\n');
    at('result').hidden = false;
    at('view').replaceChildren(at('viewer-template').content.cloneNode(true));
    stopViewing = view([said.view], ['scan', 'part']);
  }

  // Reads what is new, and whatever a program that stopped had read; registers where both are there.
  async function update() {
    if (!program) return; // why was said
    for (const cloud of clouds) {
      if (cloud.file && !cloud.isRead) await readAndTell(cloud);
    }
    if (clouds.every((cloud) => cloud.isRead)) await register();
  }
  let updates = null; // one after the other, the first when the program is there
  function take(files) {
    if (stopViewing) stopViewing();
    at('result').hidden = true;
    if (program) at('state').textContent = '';
    for (const [which, file] of files) {
      Object.assign(clouds[which], { file, isRead: false });
      clouds[which].said.textContent = '';
    }
    updates = updates.then(update).catch((error) => {
      at('state').textContent = sentence(`the page cannot go on (${error.message}): load it again`);
    });
  }
  // Of two files the first is the scan.
  function drop(event, which) {
    event.preventDefault();
    event.stopPropagation();
    const files = [...event.dataTransfer.files];
    if (files.length === 1) take([[which, files[0]]]);
    else if (files.length === 2) take([[0, files[0]], [1, files[1]]]);
    else at('state').textContent = `Drop one file, or the scan and the part: these were ${files.length}.`;
  }

  clouds.forEach(({ input }, which) => {
    input.addEventListener('change', () => input.files[0] && take([[which, input.files[0]]]));
    const label = input.closest('label');
    label.addEventListener('dragover', () => label.classList.add('over'));
    label.addEventListener('dragleave', () => label.classList.remove('over'));
    label.addEventListener('drop', (event) => {
      label.classList.remove('over');
      drop(event, which);
    });
  });
  // Elsewhere on the page one file is what is missing.
  document.addEventListener('dragover', (event) => event.preventDefault());
  document.addEventListener('drop', (event) => drop(event, clouds[0].file ? 1 : 0));
  at('anywhere').addEventListener('change', () => take([]));
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
  updates = WebAssembly.compile(bytes).then(async (module) => {
    compiled = module;
    await start();
    document.body.dataset.ready = 'yes';
  }).catch(() => {
    at('state').textContent = 'This browser does not run WebAssembly with vectors: take one of 2023 or later.';
  });
})();
