// Registers the pairs of CASES, each brought in another way, and looks at the view of the first.
(async () => {
  await ready();
  const ways = [
    (scan, part) => { drop(label('scan'), [scan]); drop(label('part'), [part]); },
    (scan, part) => drop(document.body, [scan, part]),
    (scan, part) => { choose('part', part); choose('scan', scan); },
  ];
  found.cases = [];
  for (const [i, { scan, part, anywhere }] of CASES.entries()) {
    at('anywhere').checked = anywhere;
    ways[i % ways.length](stored(scan), stored(part));
    found.cases.push(await answered());
    if (i > 0) continue;
    found.where = [at('where').textContent];
    found.steps = +at('step').max;
    found.bars = document.querySelectorAll('#bars rect').length;
    found.legend = [...at('legend').children].map((label) => label.innerText);
    found.table = at('steps').innerText;
    at('step').value = 2;
    at('step').dispatchEvent(new Event('input'));
    found.where.push(at('where').textContent);
    found.bar = document.querySelector('#bars rect.chosen title').textContent;
  }
  found.views = document.querySelectorAll('canvas').length;
  found.requests = performance.getEntriesByType('resource').length;
  finish();
})();
