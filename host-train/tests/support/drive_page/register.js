'use strict';
// Registers as a user does; every entry of `found` is checked by the test.
(async () => {
  const found = {};
  const at = (id) => document.getElementById(id);
  const until = async (holds) => {
    const began = Date.now();
    while (!holds()) {
      if (Date.now() - began > 120e3) throw new Error(`waited two minutes for ${holds}`);
      await new Promise((done) => setTimeout(done, 20));
    }
  };
  const choose = async (input, said, name, bytes) => {
    at(said).textContent = '';
    const files = new DataTransfer();
    files.items.add(new File([bytes], name));
    at(input).files = files.files;
    at(input).dispatchEvent(new Event('change'));
    await until(() => at(said).textContent !== '');
  };
  await until(() => document.body.dataset.ready === 'yes');
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

  found.errors = [];
  for (const [name, text] of [['empty.xyz', ''], ['cut.ply', 'ply\nformat'], ['photo.png', 'x'], ['one.xyz', '1 1 1\n1 1 1\n']]) {
    await choose('scan', 'scan-read', name, text);
    found.errors.push(at('scan-read').textContent);
  }
  await choose('scan', 'scan-read', 'scan.ply', bytes(FILES.scan));
  found.waits = at('result').hidden;
  await choose('part', 'part-read', 'part.ply', bytes(FILES.part));
  await until(() => at('state').textContent !== '');
  found.state = at('state').textContent;
  found.pose = at('pose').textContent;
  found.read = [at('scan-read').textContent, at('part-read').textContent];
  found.steps = +at('step').max;
  found.bars = document.querySelectorAll('#bars rect').length;
  at('step').value = 2;
  at('step').dispatchEvent(new Event('input'));
  found.where = at('where').textContent;
  // Again, from anywhere: the view is made anew.
  at('anywhere').click();
  found.anywhere = at('pose').textContent;
  found.views = document.querySelectorAll('canvas').length;
  found.requests = performance.getEntriesByType('resource').length;
  console.log('findings ' + JSON.stringify(found));
})();
