'use strict';
// Drives the report as a user does; every entry of `found` is checked by the test.
(async () => {
  const found = {};
  const at = (id) => document.getElementById(id);
  const canvas = at('scene');
  const slider = at('step');
  // Read from a copy: the browser complains of reading a canvas that is drawn on its fast path.
  const copy = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
  const read = () => {
    copy.canvas.width = canvas.width;
    copy.canvas.height = canvas.height;
    copy.drawImage(canvas, 0, 0);
    return copy.getImageData(0, 0, canvas.width, canvas.height).data;
  };
  const pixels = () => read().reduce((hash, value) => (31 * hash + value) | 0, 7);
  const opaque = () => read().reduce((count, value, i) => count + (i % 4 === 3 && value > 0), 0);
  const goTo = (step) => {
    slider.value = step;
    slider.dispatchEvent(new Event('input', { bubbles: true }));
  };
  const heights = () => [...document.querySelectorAll('#bars rect')].map((bar) => +bar.getAttribute('height'));
  const key = (name) => canvas.dispatchEvent(new KeyboardEvent('keydown', { key: name, bubbles: true }));
  const pointer = (kind, x, y) => canvas.dispatchEvent(
    new PointerEvent(kind, { pointerId: 1, clientX: x, clientY: y, bubbles: true }));
  const changed = (act) => {
    const before = pixels();
    act();
    return pixels() !== before;
  };

  const figures = [...document.querySelectorAll('figure.chart svg')];
  found.charts = figures.length;
  found.emptyCharts = figures.filter((svg) => !svg.querySelector('polyline, circle, polygon')).length;
  found.tables = document.querySelectorAll('main table').length;
  found.registrations = at('registration').options.length;
  found.steps = +slider.max;
  found.drawn = canvas.width > 200 && opaque() > 500;

  goTo(0);
  const first = pixels();
  const firstBars = heights();
  found.sliderMoves = changed(() => goTo(1)) && changed(() => goTo(slider.max));
  goTo(0);
  found.steady = pixels() === first;
  found.keyboardTurns = changed(() => key('ArrowLeft'));
  found.dragTurns = changed(() => {
    pointer('pointerdown', 50, 50);
    pointer('pointermove', 90, 70);
    pointer('pointerup', 90, 70);
  });
  found.wheelZooms = changed(() => canvas.dispatchEvent(
    new WheelEvent('wheel', { deltaY: -200, bubbles: true, cancelable: true })));
  key('0');
  found.resets = pixels() === first;
  const boxes = [...document.querySelectorAll('#legend input')];
  found.legendHides = boxes.length === 4 && changed(() => boxes[0].click()) && changed(() => boxes[0].click());

  // The tallest bar has 68 units; a bar for almost nothing is still seen, so sums lie a little above one.
  const sums = [0, 1, 2, 3, 4, 5].map((axis) => firstBars.slice(11 * axis, 11 * axis + 11).reduce((a, b) => a + b) / 68);
  found.barsSum = firstBars.length === 66 && sums.every((sum) => sum > 0.97 && sum < 1.2);
  goTo(2);
  found.barsChange = heights().some((height, i) => height !== firstBars[i]);
  const marked = () => document.querySelectorAll('#steps [aria-current]');
  const rows = at('steps').tBodies[0].rows;
  found.rowMarked = marked().length === 1 && rows[2] === marked()[0];
  found.rowSelects = changed(() => rows[0].click()) && slider.value === '0';
  found.errorShown = /ISO R \d/.test(at('where').textContent);
  found.choiceChanges = changed(() => {
    at('registration').selectedIndex = 1;
    at('registration').dispatchEvent(new Event('change', { bubbles: true }));
  });

  // Errors have columns where the truth is known: of the evaluation's pairs, not of two files.
  found.columns = [...at('registration').options].map((_, i) => {
    at('registration').selectedIndex = i;
    at('registration').dispatchEvent(new Event('change', { bubbles: true }));
    const heads = [...at('steps').tHead.rows[0].cells].filter((cell) => !cell.hidden);
    return heads.length === rows[0].cells.length ? heads.length : 0;
  });
  at('play').click();
  const began = Date.now();
  while (slider.value !== slider.max) {
    if (Date.now() - began > 120e3) throw new Error('it did not play to the end in two minutes');
    await new Promise((done) => setTimeout(done, 100));
  }
  found.playRuns = true;
  found.requests = performance.getEntriesByType('resource').length;
  found.overflow = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  console.log('findings ' + JSON.stringify(found));
})();
