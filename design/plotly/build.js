// Writes plotly.js.gz with the traces that our figures have. A page that holds it is then a fifth
// of one with all of plotly.js, and opens without a network. `make plotly` runs it.
const { build } = require("esbuild");
const { environmentPlugin } = require("esbuild-plugin-environment");
const { glsl } = require("esbuild-plugin-glsl");
const inlineCss = require("esbuild-plugin-inline-css");
const fs = require("fs");
const path = require("path");
const zlib = require("zlib");

const traces = ["bar", "heatmap", "histogram", "scatter3d", "scatterpolar"];
const { version } = require("plotly.js/package.json");
const banner = `/**
* plotly.js v${version} (${traces.join(", ")})
* Copyright 2012-2025, Plotly, Inc.
* All rights reserved.
* Licensed under the MIT license
*/`;

build({
  stdin: {
    contents: `const Plotly = require("plotly.js/lib/core");
      Plotly.register([${traces.map((t) => `require("plotly.js/lib/${t}")`)}]);
      module.exports = Plotly;`,
    resolveDir: __dirname,
  },
  format: "iife", globalName: "Plotly", bundle: true, minify: true, write: false,
  plugins: [inlineCss(), glsl({ minify: true }), environmentPlugin({ NODE_DEBUG: false })],
  alias: { stream: "stream-browserify" },
  define: { global: "window", "define.amd": "false" },
  target: "es2020", legalComments: "none",
}).then(({ outputFiles }) => {
  const code = Buffer.concat([Buffer.from(banner + "\n"), outputFiles[0].contents]);
  const target = path.join(__dirname, "../../src/foucault/report/plotly.js.gz");
  fs.writeFileSync(target, zlib.gzipSync(code, { level: 9 })); // zopfli packs it 4 % tighter
});
