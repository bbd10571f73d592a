// Prints the page that the search of a built site shows first, for every query: node search.js SITE QUERY ...
// The search asks the page that it stands on for some names, which are given here.
globalThis._ready = () => {};
globalThis.window = globalThis;
globalThis._ = (text) => text;
globalThis.SPHINX_HIGHLIGHT_ENABLED = false;
globalThis.document = { getElementById: () => null };
const { readFileSync } = require("fs"), [, , site, ...queries] = process.argv;
const files = ["_static/language_data.js", "_static/searchtools.js", "searchindex.js"];
const program = files.map((file) => readFileSync(`${site}/${file}`, "utf8")).join("\n");
const Search = require("vm").runInThisContext(`${program}; Search`);
for (const query of queries) console.log(Search._performSearch(...Search._parseQuery(query)).pop()[0]);
