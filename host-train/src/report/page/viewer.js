'use strict';
// The view of registrations: clouds on a canvas, a slider over the steps, probabilities as bars; the clouds are
// called what the page calls them. Returns what stops it.
function view(registrations, [source, target] = ['source', 'target']) {
  const SIZES = [-0.27, -0.09, -0.03, -0.01, -0.0033, 0, 0.0033, 0.01, 0.03, 0.09, 0.27];
  const AXES = [
    'Translation x', 'Translation y', 'Translation z',
    'Rotation x', 'Rotation y', 'Rotation z',
  ];
  const CLOUDS = [
    { key: 'target', name: target, mark: 'square' },
    { key: 'source', name: `${source} as observed`, mark: 'cross' },
    { key: 'initial', name: `${source} in the initial pose`, mark: 'ring' },
    { key: 'current', name: `${source} after the step`, mark: 'disc' },
  ];
  const SVG = 'http://www.w3.org/2000/svg';
  const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
  const START = multiply(turn(0, 0.45), turn(1, -0.6));

  const at = (id) => document.getElementById(id);
  const canvas = at('scene');
  const pick = at('registration');
  const slider = at('step');
  const play = at('play');
  const shown = { target: true, source: false, initial: true, current: true };
  let registration = registrations[0];
  let orientation = START;
  let zoom = 1;
  let fit = 1;
  let timer = null;

  // 3x3 matrices, row by row.
  function turn(axis, angle) {
    const c = Math.cos(angle), s = Math.sin(angle);
    return axis === 0 ? [1, 0, 0, 0, c, -s, 0, s, c] : [c, 0, s, 0, 1, 0, -s, 0, c];
  }
  function multiply(a, b) {
    const out = [];
    for (let i = 0; i < 3; i++) {
      for (let j = 0; j < 3; j++) {
        out.push(a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j]);
      }
    }
    return out;
  }
  // A cloud of thousandths under a pose.
  function moved(flat, pose) {
    const out = new Float64Array(flat.length);
    for (let i = 0; i < flat.length; i += 3) {
      const x = flat[i] / 1000, y = flat[i + 1] / 1000, z = flat[i + 2] / 1000;
      for (let r = 0; r < 3; r++) {
        out[i + r] = pose[4 * r] * x + pose[4 * r + 1] * y + pose[4 * r + 2] * z + pose[4 * r + 3];
      }
    }
    return out;
  }
  function cloud(key) {
    switch (key) {
      case 'target': return moved(registration.target, IDENTITY);
      case 'source': return moved(registration.source, IDENTITY);
      case 'initial': return moved(registration.source, registration.poses[0]);
      default: return moved(registration.source, registration.poses[+slider.value]);
    }
  }
  function radius(points) {
    let most = 0;
    for (let i = 0; i < points.length; i += 3) {
      most = Math.max(most, Math.hypot(points[i], points[i + 1], points[i + 2]));
    }
    return most;
  }

  function colours() {
    const style = getComputedStyle(at('viewer'));
    return Object.fromEntries(CLOUDS.map((c) => [c.key, style.getPropertyValue('--' + c.key).trim()]));
  }
  function mark(context, kind, x, y, r) {
    if (kind === 'square') {
      context.fillRect(x - r, y - r, 2 * r, 2 * r);
    } else if (kind === 'cross') {
      context.beginPath();
      context.moveTo(x - r, y - r); context.lineTo(x + r, y + r);
      context.moveTo(x - r, y + r); context.lineTo(x + r, y - r);
      context.stroke();
    } else {
      context.beginPath();
      context.arc(x, y, kind === 'ring' ? r * 1.1 : r * 1.15, 0, 2 * Math.PI);
      if (kind === 'ring') context.stroke(); else context.fill();
    }
  }
  function draw() {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    const context = canvas.getContext('2d');
    context.clearRect(0, 0, width, height);
    const scale = 0.53 * Math.min(width, height) * zoom / fit;
    const places = [];
    for (const { key, mark: kind } of CLOUDS) {
      if (!shown[key]) continue;
      const points = cloud(key);
      const m = orientation;
      for (let i = 0; i < points.length; i += 3) {
        const [x, y, z] = [points[i], points[i + 1], points[i + 2]];
        const depth = (m[6] * x + m[7] * y + m[8] * z) / fit;
        const near = 1 / Math.max(0.2, 1 - 0.22 * depth);
        places.push([
          depth,
          width / 2 + (m[0] * x + m[1] * y + m[2] * z) * scale * near,
          height / 2 - (m[3] * x + m[4] * y + m[5] * z) * scale * near,
          near, key, kind,
        ]);
      }
    }
    places.sort((a, b) => a[0] - b[0]);
    const colour = colours();
    const size = 1.9 * ratio * Math.sqrt(Math.min(zoom, 6));
    for (const [depth, x, y, near, key, kind] of places) {
      context.globalAlpha = Math.min(1, Math.max(0.35, 0.72 + 0.35 * depth));
      context.fillStyle = context.strokeStyle = colour[key];
      context.lineWidth = 1.1 * ratio;
      mark(context, kind, x, y, size * near);
    }
    context.globalAlpha = 1;
  }

  const signed = (x) => (x === 0 ? '0' : (x > 0 ? '+' : '\u2212') + Math.abs(x));
  // Four significant digits at most, without an exponent where that can be.
  const length = (x) => (x === 0 ? '0' : (x > 0 ? '+' : '\u2212') + String(+Math.abs(x).toPrecision(3)));
  // Of a probability in thousandths; never rounded to certainty.
  const percent = (p) => (p > 999 ? 'over 99.9 %' : p > 990 ? `${p / 10} %` : p < 10 ? 'under 1 %' : `${(p / 10).toFixed(0)} %`);

  // One small chart an axis, made once; bars are set with each step.
  const charts = AXES.map((name) => {
    const box = document.createElement('figure');
    const title = document.createElement('figcaption');
    const svg = document.createElementNS(SVG, 'svg');
    svg.setAttribute('viewBox', '-6 0 232 98');
    svg.setAttribute('role', 'img');
    const add = (tag, attributes) => {
      const element = document.createElementNS(SVG, tag);
      for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
      svg.append(element);
      return element;
    };
    add('line', { x1: 0, x2: 220, y1: 72.5, y2: 72.5, class: 'base' });
    const bars = SIZES.map((size, i) => {
      const bar = add('rect', { x: 20 * i + 3, width: 14, y: 72, height: 0 });
      bar.append(document.createElementNS(SVG, 'title'));
      return bar;
    });
    // In two rows, so that all have room.
    SIZES.forEach((size, i) => {
      const text = add('text', { x: 20 * i + 10, y: i % 2 ? 95 : 84, 'text-anchor': 'middle' });
      text.textContent = signed(size).replace('0.', '.');
    });
    box.append(title, svg);
    at('bars').append(box);
    return { name, title, svg, bars };
  });

  function showDecision(step) {
    const taken = registration.steps[step];
    at('decision').textContent = taken
      ? `Step ${step + 1}: what the policy chooses here`
      : registration.answer && step === registration.steps.length
        ? 'After the last step: the pose is refined and compared with others'
        : 'Final pose: no further step';
    charts.forEach(({ name, title, svg, bars }, axis) => {
      const chosen = taken ? taken.ids[axis] : -1;
      const probabilities = taken && taken.probabilities ? taken.probabilities[axis] : null;
      const unit = axis < 3 ? '' : ' rad';
      title.textContent = name;
      if (taken) {
        const value = document.createElement('b');
        value.textContent = ` ${axis < 3 ? length(taken.signed[axis]) : signed(SIZES[chosen])}${unit}`;
        title.append(value);
        if (probabilities) title.append(` ${percent(probabilities[chosen])}`);
      }
      bars.forEach((bar, i) => {
        const p = probabilities ? probabilities[i] / 1000 : (i === chosen ? 1 : 0);
        const high = p > 0 ? Math.max(1, 68 * p) : 0;
        bar.setAttribute('y', 72 - high);
        bar.setAttribute('height', high);
        bar.setAttribute('class', i === chosen ? 'chosen' : '');
        bar.firstChild.textContent = signed(SIZES[i]) + (probabilities ? `: ${percent(probabilities[i])}` : '');
      });
      svg.setAttribute('aria-label', title.textContent);
    });
  }
  function showWhere(step) {
    const last = registration.steps.length;
    let text = step === 0 ? `initial pose (of ${last} steps)` : `after step ${step} of ${last}`;
    if (step > last) text = `answer \u00b7 ${registration.answer}`;
    const errors = registration.errors && registration.errors[step];
    if (errors) text += ` \u00b7 ISO R ${errors[0].toFixed(2)} deg \u00b7 ISO t ${errors[1].toFixed(4)}`;
    at('where').textContent = text;
    slider.setAttribute('aria-valuetext', text);
    canvas.setAttribute('aria-label', `Point clouds of ${registration.name}, ${text}`);
    for (const row of at('steps').tBodies[0].rows) {
      if (row.rowIndex - 1 === step) row.setAttribute('aria-current', 'step');
      else row.removeAttribute('aria-current');
    }
  }
  function showStep() {
    const step = +slider.value;
    showWhere(step);
    showDecision(step);
    draw();
  }
  function goTo(step) {
    slider.value = step;
    showStep();
  }

  function showTable() {
    const body = at('steps').tBodies[0];
    body.replaceChildren();
    // Where the truth is not known there are no errors.
    for (const part of at('viewer').querySelectorAll('.of-truth')) part.hidden = !registration.errors;
    registration.poses.forEach((_, i) => {
      const row = body.insertRow();
      const taken = registration.steps[i - 1];
      const cells = [i === 0 ? 'init' : taken ? i : 'answer'];
      for (let axis = 0; axis < 6; axis++) {
        if (!taken) cells.push('');
        else cells.push(axis < 3 ? length(taken.signed[axis]) : signed(SIZES[taken.ids[axis]]));
      }
      if (registration.errors) {
        const [angle, distance] = registration.errors[i];
        cells.push(angle.toFixed(2), distance.toFixed(4));
      }
      for (const text of cells) row.insertCell().textContent = text;
      row.addEventListener('click', () => goTo(i));
    });
  }
  function showRegistration() {
    stop();
    registration = registrations[+pick.value];
    slider.max = registration.poses.length - 1;
    slider.value = slider.max; // the answer is seen first
    const [n, m] = registration.points;
    at('about').textContent = `policy ${registration.policy} \u00b7 ${n} ${source} and ${m} ${target} points \u00b7 radius of the ${target} ${+registration.radius.toPrecision(4)}`;
    fit = Math.max(1, radius(cloud('initial')), radius(cloud('target')));
    zoom = 1;
    showTable();
    showStep();
  }

  function stop() {
    clearInterval(timer);
    timer = null;
    play.textContent = '\u25b6';
    play.setAttribute('aria-label', 'Play the steps');
  }
  function start() {
    if (slider.value === slider.max) goTo(0);
    play.textContent = '\u275a\u275a';
    play.setAttribute('aria-label', 'Pause');
    timer = setInterval(() => {
      goTo(+slider.value + 1);
      if (slider.value === slider.max) stop();
    }, 700);
  }

  CLOUDS.forEach(({ key, name, mark: kind }) => {
    const label = document.createElement('label');
    const box = document.createElement('input');
    box.type = 'checkbox';
    box.checked = shown[key];
    box.addEventListener('change', () => { shown[key] = box.checked; draw(); });
    const swatch = document.createElement('span');
    swatch.className = `swatch ${kind}`;
    swatch.style.setProperty('--cloud', `var(--${key})`);
    label.append(box, swatch, name);
    at('legend').append(label);
  });
  const policies = [...new Set(registrations.map((r) => r.policy))];
  for (const policy of policies) {
    const group = document.createElement('optgroup');
    group.label = policy;
    registrations.forEach((r, i) => {
      if (r.policy === policy) group.append(new Option(`${r.name} (${policy})`, i));
    });
    pick.append(group);
  }

  pick.addEventListener('change', showRegistration);
  slider.addEventListener('input', () => { stop(); showStep(); });
  play.addEventListener('click', () => (timer ? stop() : start()));

  const turnBy = (dx, dy) => {
    orientation = multiply(multiply(turn(0, dy), turn(1, dx)), orientation);
    draw();
  };
  const zoomBy = (factor) => {
    zoom = Math.min(30, Math.max(0.2, zoom * factor));
    draw();
  };
  const reset = () => {
    orientation = START;
    zoom = 1;
    draw();
  };
  // One pointer turns, two zoom.
  const pointers = new Map();
  canvas.addEventListener('pointerdown', (event) => {
    pointers.set(event.pointerId, event);
    try { canvas.setPointerCapture(event.pointerId); } catch { /* not a real pointer */ }
  });
  canvas.addEventListener('pointermove', (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    if (pointers.size === 1) {
      const whole = Math.min(canvas.clientWidth, canvas.clientHeight) || 1;
      turnBy(3 * (event.clientX - before.clientX) / whole, 3 * (event.clientY - before.clientY) / whole);
    } else {
      const other = [...pointers.values()].find((p) => p.pointerId !== event.pointerId);
      const apart = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY) || 1;
      zoomBy(apart(event) / apart(before));
    }
    pointers.set(event.pointerId, event);
  });
  for (const kind of ['pointerup', 'pointercancel']) {
    canvas.addEventListener(kind, (event) => pointers.delete(event.pointerId));
  }
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    zoomBy(Math.exp(-0.0015 * event.deltaY));
  }, { passive: false });
  canvas.addEventListener('dblclick', reset);
  canvas.addEventListener('keydown', (event) => {
    const keys = {
      ArrowLeft: () => turnBy(-0.12, 0),
      ArrowRight: () => turnBy(0.12, 0),
      ArrowUp: () => turnBy(0, -0.12),
      ArrowDown: () => turnBy(0, 0.12),
      '+': () => zoomBy(1.15),
      '=': () => zoomBy(1.15),
      '-': () => zoomBy(1 / 1.15),
      0: reset,
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  window.addEventListener('resize', draw);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
  showRegistration();
  return stop;
}
