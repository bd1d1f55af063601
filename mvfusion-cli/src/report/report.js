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
