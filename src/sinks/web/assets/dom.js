// Small helpers. Touch an element only when its text changes: screen readers, and batteries.

export const $ = (id) => document.getElementById(id);

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function setAttr(element, name, value) {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

export function make(tag, className, text) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  return element;
}

export function chip(id, level, value) {
  const element = $(id);
  setAttr(element, "data-level", level);
  setText(element.querySelector(".value"), value);
}

export function list(element, texts) {
  const key = texts.join("\n");
  if (element.dataset.key === key) return;
  element.dataset.key = key;
  element.replaceChildren(...texts.map((text) => make("li", "", text)));
}

export function facts(element, pairs) {
  if (element.children.length !== pairs.length * 2) {
    element.replaceChildren(...pairs.flatMap(() => [make("dt"), make("dd")]));
  }
  pairs.forEach(([name, value], i) => {
    setText(element.children[2 * i], name);
    setText(element.children[2 * i + 1], value);
  });
}

/** A number stays on the line of its unit. */
export const joined = (text) => text.replace(/(\d) (?=(s|m|g|Hz|deg)\b)/g, "$1\u00a0");

export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
