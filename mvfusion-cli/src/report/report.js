'use strict';
// Shows what needs a script.
document.documentElement.classList.add('js');

// A picture that is shown again is copied from where it stands.
const copy = (picture, id) => {
  const source = document.getElementById(id);
  if (source) picture.src = source.src;
};
for (const picture of document.querySelectorAll('img[data-copy]')) copy(picture, picture.dataset.copy);

// Before and after: the range moves the edge at which the right picture begins.
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

// A click on a picture of a row, or Enter, shows it large, and small again.
for (const figure of document.querySelectorAll('.row figure')) {
  const toggle = () => figure.classList.toggle('large');
  figure.tabIndex = 0;
  figure.addEventListener('click', toggle);
  figure.addEventListener('keydown', event => { if (event.key === 'Enter') toggle(); });
}

// Tables of views: a click on a column sorts by it, another one the other way round.
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

// What is folded up is printed as well.
addEventListener('beforeprint', () => {
  for (const details of document.querySelectorAll('details')) details.open = true;
});
