// Small helpers for the page.

/** @param {string} id @returns {any} */
export function element(id) {
  return document.getElementById(id);
}

/**
 * Offers a file for download.
 * @param {Blob} file
 * @param {string} name
 */
export function download(file, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
