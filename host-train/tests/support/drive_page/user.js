'use strict';
// What a user does on the page; FILES are the bytes in base64, by name.
const at = (id) => document.getElementById(id);
const until = async (holds) => {
  const began = Date.now();
  while (!holds()) {
    if (Date.now() - began > 120e3) throw new Error(`waited two minutes for ${holds}`);
    await new Promise((done) => setTimeout(done, 20));
  }
};
const ready = () => until(() => document.body.dataset.ready === 'yes');
const stored = (name) => new File([Uint8Array.from(atob(FILES[name]), (c) => c.charCodeAt(0))], name);
const held = (files) => {
  const data = new DataTransfer();
  for (const file of files) data.items.add(file);
  return data;
};
const label = (which) => at(which).closest('label');
const choose = (which, file) => {
  at(which).files = held([file]).files;
  at(which).dispatchEvent(new Event('change'));
};
const drop = (place, files) => place.dispatchEvent(
  new DragEvent('drop', { dataTransfer: held(files), bubbles: true, cancelable: true }));
// What the page says of the pose, when it says anything.
const answered = async () => {
  await until(() => at('state').textContent !== '');
  return {
    state: at('state').textContent,
    isShown: !at('result').hidden,
    pose: at('pose').textContent,
    sentences: [...at('sentences').children].map((item) => item.textContent),
    others: at('others').hidden ? '' : at('other-poses').textContent,
  };
};
const found = {};
const finish = () => console.log('findings ' + JSON.stringify(found));
