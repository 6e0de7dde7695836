// Brings files that cannot be read, and stops the program.
(async () => {
  await ready();
  // As of a folder: its bytes cannot be had.
  const folder = new File([], 'folder');
  const { arrayBuffer } = Blob.prototype;
  Blob.prototype.arrayBuffer = function bytes() {
    return this.name === 'folder' ? Promise.reject(new DOMException('gone', 'NotFoundError')) : arrayBuffer.call(this);
  };
  const said = async (which) => {
    await until(() => at(`${which}-read`).textContent !== '');
    return at(`${which}-read`).textContent;
  };
  const whole = { scan: stored('scan.ply'), part: stored('part.ply') };

  found.errors = [];
  for (const [name, text] of [['empty.xyz', ''], ['cut.ply', 'ply\nformat'], ['photo.png', 'x'], ['one.xyz', '1 1 1\n1 1 1\n']]) {
    choose('scan', new File([text], name));
    found.errors.push(await said('scan'));
  }
  choose('scan', whole.scan);
  await said('scan');
  found.waits = at('result').hidden;
  drop(document.body, [whole.part]);
  found.first = await answered();

  // What cannot be read ends what was shown; the other cloud stays.
  drop(label('scan'), [folder]);
  found.folder = [await said('scan'), at('state').textContent, at('result').hidden];
  drop(document.body, [whole.scan]);
  found.again = await answered();
  drop(document.body, [folder, whole.scan, whole.part]);
  found.three = at('state').textContent;
  // Of two drops in a row the last counts.
  drop(label('part'), [folder]);
  drop(label('part'), [whole.part]);
  found.last = await answered();

  // The next registration stops the program; another takes its place, and reads what was there.
  trap = true;
  drop(label('scan'), [whole.scan]);
  found.stopped = await answered();
  drop(label('scan'), [whole.scan]);
  found.after = await answered();
  finish();
})();
