'use strict';
// Show the parts that need a script.
document.documentElement.classList.add('js');

// Copy repeated images from their first occurrence.
const copy = (picture, id) => {
  const source = document.getElementById(id);
  if (source) picture.src = source.src;
};
for (const picture of document.querySelectorAll('img[data-copy]')) copy(picture, picture.dataset.copy);

// Comparison: the range moves the boundary between the two images.
for (const figure of document.querySelectorAll('figure.slider')) {
  const range = figure.querySelector('input');
  const move = () => figure.style.setProperty('--at', range.value + '%');
  range.addEventListener('input', move);
  // Browsers restore the range after a reload.
  move();
  for (const choice of figure.querySelectorAll('select')) {
    const picture = figure.querySelector('img.' + choice.dataset.side);
    choice.addEventListener('change', () => copy(picture, choice.value));
  }
}

// The film: a slider through time, two screens, and a button that plays.
for (const film of document.querySelectorAll('figure.film')) {
  const frames = [...film.querySelectorAll('.frames li')];
  const range = film.querySelector('.moment');
  const button = film.querySelector('.play');
  const caption = film.querySelector('.caption');
  const screens = [...film.querySelectorAll('.screen')];
  const FRAME_MS = 1000 / 15;
  let clock = 0;

  // A picture is shown once it is decoded, unless a newer one is wanted by then.
  const show = async screen => {
    const picture = screen.querySelector('img');
    const source = frames[range.value].querySelector('data.' + picture.dataset.kind);
    const wanted = source ? source.value : 'data:,';
    picture.dataset.wanted = range.value + picture.dataset.kind;
    const next = new Image();
    next.src = wanted;
    const mark = picture.dataset.wanted;
    if (!picture.src) picture.src = wanted;
    await next.decode().catch(() => {});
    if (picture.dataset.wanted !== mark) return;
    if (source) picture.src = wanted; else picture.removeAttribute('src');
  };
  const move = () => {
    caption.value = frames[range.value].dataset.caption;
    film.style.setProperty('--at', range.value / (frames.length - 1));
    range.setAttribute('aria-valuetext', caption.value);
    return Promise.all(screens.map(show));
  };
  const go = index => {
    range.value = index;
    return move();
  };

  const stop = () => {
    cancelAnimationFrame(clock);
    clock = 0;
    button.textContent = 'Play';
    button.ariaPressed = 'false';
  };
  const play = () => {
    button.textContent = 'Pause';
    button.ariaPressed = 'true';
    let last = performance.now();
    const tick = async now => {
      if (now - last >= FRAME_MS) {
        last = now;
        await go((Number(range.value) + 1) % frames.length);
        if (!clock) return;
      }
      clock = requestAnimationFrame(tick);
    };
    clock = requestAnimationFrame(tick);
  };
  const toggle = () => (clock ? stop() : play());

  button.addEventListener('click', toggle);
  range.addEventListener('input', () => { stop(); move(); });
  range.addEventListener('keydown', event => {
    if (event.key === ' ') { event.preventDefault(); if (!event.repeat) toggle(); }
  });
  for (const screen of screens) {
    screen.querySelector('select').addEventListener('change', event => {
      screen.querySelector('img').dataset.kind = event.target.value;
      show(screen);
    });
    // A drag over a picture moves through the whole film in its width.
    const picture = screen.querySelector('img');
    let begin = null;
    picture.addEventListener('pointerdown', event => {
      stop();
      picture.setPointerCapture(event.pointerId);
      begin = { x: event.clientX, index: Number(range.value) };
    });
    picture.addEventListener('pointermove', event => {
      if (!begin) return;
      const share = (event.clientX - begin.x) / picture.clientWidth;
      go(Math.max(0, Math.min(frames.length - 1, Math.round(begin.index + share * (frames.length - 1)))));
    });
    for (const end of ['pointerup', 'pointercancel']) picture.addEventListener(end, () => { begin = null; });
  }
  addEventListener('visibilitychange', () => { if (document.hidden) stop(); });
  move();
}

// A click on an image of a row, or Enter, toggles its large size.
for (const figure of document.querySelectorAll('.row figure')) {
  const toggle = () => figure.classList.toggle('large');
  figure.tabIndex = 0;
  figure.addEventListener('click', toggle);
  figure.addEventListener('keydown', event => { if (event.key === 'Enter') toggle(); });
}

// Tables of views: a click on a column sorts by it, a second click reverses the order.
for (const table of document.querySelectorAll('table.sortable')) {
  const body = table.tBodies[0];
  for (const head of table.tHead.rows[0].cells) {
    const button = document.createElement('button');
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener('click', () => {
      const descends = head.ariaSort === 'ascending';
      for (const other of table.tHead.rows[0].cells) other.ariaSort = null;
      head.ariaSort = descends ? 'descending' : 'ascending';
      const text = row => row.cells[head.cellIndex].textContent;
      const order = (a, b) => {
        const [x, y] = [a, b].map(row => parseFloat(text(row)));
        if (Number.isFinite(x) && Number.isFinite(y) && x !== y) return x - y;
        return text(a).localeCompare(text(b), 'en', { numeric: true });
      };
      const rows = [...body.rows].sort((a, b) => (descends ? order(b, a) : order(a, b)));
      body.append(...rows);
    });
  }
}

// Open folded parts for printing.
addEventListener('beforeprint', () => {
  for (const details of document.querySelectorAll('details')) details.open = true;
});
