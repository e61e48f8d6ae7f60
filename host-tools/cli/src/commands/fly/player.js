// Moves what is marked "now" in the pictures to a moment of the flight.
(() => {
  const film = JSON.parse(document.getElementById('film').textContent);
  if (film.frames.length < 2) return;
  const [play, slider, speed, said] = ['play', 'time', 'speed', 'now'].map(id => document.getElementById(id));
  const chart = name => {
    const area = document.querySelector(`[data-chart="${name}"]`);
    return { area, find: what => area.querySelector(`.now .${what}`) };
  };
  const maps = ['above', 'side'].map(name => ({
    name,
    flown: chart(name).find('flown'),
    ellipse: chart(name).find('ellipse'),
    estimate: chart(name).find('estimate'),
    goal: chart(name).find('goal'),
    vehicle: chart(name).find('vehicle'),
    points: film.frames.map(frame => frame[name].join()),
  }));
  const { find, area } = chart('error');
  const [cursor, errorAt] = [find('cursor'), find('error-at')];
  const box = document.querySelector('#error-area rect');
  const [left, width, top, height] = ['x', 'width', 'y', 'height'].map(a => +box.getAttribute(a));

  // The last of a list that has begun at time t.
  const latest = (list, t) => {
    let [low, high] = [0, list.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (list[middle].t <= t) low = middle + 1; else high = middle;
    }
    return low - 1;
  };
  const place = (element, at, turn) => {
    element.style.display = at ? '' : 'none';
    if (at) element.setAttribute('transform', `translate(${at})${turn ? ` rotate(${turn})` : ''}`);
  };
  const set = (element, attributes) => {
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  };

  const show = t => {
    const index = Math.max(0, latest(film.frames, t));
    const frame = film.frames[index];
    const next = film.frames[Math.min(index + 1, film.frames.length - 1)];
    const part = next.t > frame.t ? Math.min(1, Math.max(0, (t - frame.t) / (next.t - frame.t))) : 0;
    const belief = film.beliefs[latest(film.beliefs, t)];
    const order = film.orders[latest(film.orders, t)];
    const phase = film.phases.filter(([start]) => start <= t).pop();
    for (const map of maps) {
      const here = frame[map.name].map((v, axis) => v + part * (next[map.name][axis] - v));
      place(map.vehicle, here);
      map.flown.setAttribute('points', map.points.slice(0, index + 1).join(' ') + ' ' + here);
      const mark = belief && belief[map.name];
      place(map.estimate, mark && mark.at);
      place(map.ellipse, mark && mark.ellipse && mark.at, mark && mark.ellipse && mark.ellipse[2]);
      if (mark && mark.ellipse) set(map.ellipse, { rx: mark.ellipse[0], ry: mark.ellipse[1] });
      place(map.goal, order && order.action !== 'hold' && order[map.name]);
    }
    const x = left + width * Math.min(1, t / Math.max(1, film.end_s));
    set(cursor, { x1: x, x2: x, y1: top, y2: top + height });
    place(errorAt, frame.error && [x, frame.error[1]]);
    const metres = value => value < 10 ? value.toFixed(2) : value.toFixed(1);
    const words = [`${t.toFixed(1)} s`];
    if (phase) words.push(phase[1]);
    if (order) words.push(order.action);
    words.push(`height ${metres(frame.height_m)} m`);
    if (frame.error) words.push(`error ${metres(frame.error[0])} m`);
    if (frame.claimed_m !== null) words.push(`95 % within ${metres(frame.claimed_m)} m`);
    said.textContent = words.join('   ');
  };

  let running = false;
  let before = null;
  const step = now => {
    if (!running) return;
    const t = Math.min(film.end_s, +slider.value + (before === null ? 0 : (now - before) / 1000 * +speed.value));
    before = now;
    slider.value = t;
    show(t);
    if (t >= film.end_s) stop(); else requestAnimationFrame(step);
  };
  const stop = () => { running = false; play.textContent = 'Play'; };
  const start = () => {
    if (+slider.value >= film.end_s) slider.value = 0;
    running = true;
    before = null;
    play.textContent = 'Pause';
    document.body.classList.add('played');
    requestAnimationFrame(step);
  };
  play.addEventListener('click', () => running ? stop() : start());
  slider.addEventListener('input', () => {
    document.body.classList.add('played');
    before = null;
    show(+slider.value);
  });
  // `page.html#t=30` opens at 30 s.
  const opened = location.hash.match(/^#t=([\d.]+)$/);
  slider.max = film.end_s;
  slider.value = opened ? opened[1] : film.end_s;
  if (opened) document.body.classList.add('played');
  show(+slider.value);
  document.getElementById('player').hidden = false;
})();
