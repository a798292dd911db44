// Elements of the page and its words. Text from a recording only ever becomes a text node here: see element().

/**
 * An element that is in the page from the beginning.
 * @param {string} id
 */
function byId(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`this page has no element #${id}`);
  return found;
}

/** @type {PageFacts} */
const facts = JSON.parse(byId("facts").textContent ?? "");

/**
 * A sentence of the catalogue with its values filled in.
 * @param {string} key
 * @param {Record<string, string | number>} [values]
 */
function word(key, values = {}) {
  const [section, name] = key.split(".");
  return (facts.words[section]?.[name] ?? name).replace(/\{(\w+)\}/g, (_, value) => String(values[value] ?? ""));
}

/**
 * An element with attributes and children; strings become text, so that nothing is ever taken for markup.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {Record<string, string | boolean>} attributes
 * @param {...(Node | string)} children
 */
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

/**
 * Markup that the report's templates made, as an element.
 * @param {string} tag of the element to hold it
 * @param {string} html
 */
function fragment(tag, html) {
  const holder = document.createElement(tag);
  holder.innerHTML = html;
  return holder;
}
