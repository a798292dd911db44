// Runs the page's own scripts, which share one scope and know no modules, against as much of a document as they ask for.

const {readFileSync} = require("node:fs");
const {join} = require("node:path");

const ASSETS = join(__dirname, "..", "..", "weld_force_ros", "report", "assets");

class FakeElement {
  constructor(tag) {
    this.tag = tag;
    this.attributes = new Map();
    this.children = [];
    this.listeners = new Map();
    this.parent = null;
    this.style = {};
  }

  setAttribute(name, value) { this.attributes.set(name, value); }
  removeAttribute(name) { this.attributes.delete(name); }
  addEventListener(name, listener) { this.listeners.set(name, listener); }
  fire(name, event = {}) { this.listeners.get(name)(event); }
  append(...children) { for (const child of children) this.insertBefore(child, null); }
  replaceChildren(...children) {
    this.children = [];
    this.append(...children);
  }

  insertBefore(child, before) {
    if (child instanceof FakeElement) {
      child.remove();
      child.parent = this;
    }
    this.children.splice(before === null ? this.children.length : this.children.indexOf(before), 0, child);
  }

  remove() {
    if (this.parent) this.parent.children = this.parent.children.filter((child) => child !== this);
    this.parent = null;
  }

  contains(other) { return other === this || this.children.some((child) => child instanceof FakeElement && child.contains(other)); }
  get firstChild() { return this.children[0] ?? null; }
  get nextSibling() { return this.parent?.children[this.parent.children.indexOf(this) + 1] ?? null; }
  get textContent() { return this.children.map((child) => (child instanceof FakeElement ? child.textContent : child)).join(""); }
  set textContent(text) { this.children = [text]; }
  get dataset() { return {decision: this.attributes.get("data-decision")}; }
  focus() {}
}

// The named values of the scripts. `embedded` is what stands in elements of the page, by their ids.
function load(scripts, names, {embedded = {}, ...globals} = {}) {
  const elements = new Map(Object.entries(embedded).map(([id, content]) => {
    const holder = new FakeElement("script");
    holder.textContent = typeof content === "string" ? content : JSON.stringify(content);
    return [id, holder];
  }));
  const document = {
    createElement: (tag) => new FakeElement(tag),
    getElementById: (id) => elements.get(id) ?? null,
    activeElement: null,
    readyState: "complete",
  };
  const shared = {document, HTMLElement: FakeElement, Element: FakeElement, ...globals};
  const text = scripts.map((name) => readFileSync(join(ASSETS, name), "utf-8")).join("\n");
  return new Function(...Object.keys(shared), `"use strict";\n${text}\nreturn {${names.join(", ")}};`)(...Object.values(shared));
}

module.exports = {FakeElement, load};
