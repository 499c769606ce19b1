// Draws the figures that stand in the page as JSON over the still ones that show without a script.
// A colour written "var(--name)" is taken from the style sheet, so that figures follow light, dark
// and print like everything else.
(function () {
  "use strict";
  const root = document.documentElement;
  const plots = [...document.querySelectorAll(".plot")].map((box) => {
    const text = box.querySelector("script");
    const figure = JSON.parse(text.textContent);
    text.remove();
    return { box, figure };
  });
  const config = { displaylogo: false, responsive: true, displayModeBar: false, plotlyServerURL: "" };
  const mouse = matchMedia("(pointer: fine)").matches; // a finger must scroll, not zoom

  function painted(value, style) {
    if (typeof value === "string") {
      return value.startsWith("var(") ? style.getPropertyValue(value.slice(4, -1)).trim() : value;
    }
    if (Array.isArray(value)) return value.map((item) => painted(item, style));
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, painted(v, style)]));
    }
    return value;
  }

  // A figure with choices draws the traces of one of them at a time; a list says which.
  function offer(plot) {
    const { choices, choose } = plot.figure.layout.meta ?? {};
    if (!choices) return;
    const label = document.createElement("label");
    plot.list = document.createElement("select");
    plot.list.append(...choices.map((name) => new Option(name)));
    plot.list.addEventListener("change", () => draw([plot]));
    label.className = "choice";
    label.append(choose + " ", plot.list);
    plot.box.before(label);
  }

  function draw(which = plots) {
    const style = getComputedStyle(root);
    for (const { box, figure, list } of which) {
      if (box.offsetParent === null) continue; // not shown in this medium
      const chosen = { ...figure };
      if (list) chosen.data = figure.data.filter((trace) => trace.meta === list.value);
      const { data, layout } = painted(chosen, style);
      // A figure that would be crowded is as wide as it must be, and scrolls.
      layout.width = Math.max(box.clientWidth, root.classList.contains("print") ? 0 : layout.meta?.least ?? 0);
      if (root.classList.contains("print")) layout.height *= 0.8;
      layout.height = Math.min(layout.height, box.clientWidth * (layout.meta?.ratio ?? Infinity));
      if (box.clientWidth < 480) {
        for (const [key, less] of Object.entries(layout.meta?.narrow ?? {})) {
          layout[key] = typeof less === "object" ? Object.assign(layout[key], less) : less;
        }
      }
      if (mouse && layout.meta?.zoom) layout.dragmode = "zoom";
      box.style.height = layout.height + "px";
      box.querySelector(".still")?.remove();
      Plotly.react(box, data, layout, config);
    }
  }

  function print(on) {
    root.classList.toggle("print", on);
    draw();
  }

  // A button that copies the lines it stands beside.
  for (const block of document.querySelectorAll(".code")) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "Copy";
    button.addEventListener("click", () => {
      getSelection().selectAllChildren(block.querySelector("code"));
      const done = navigator.clipboard
        ? navigator.clipboard.writeText(block.querySelector("code").textContent)
        : Promise.resolve(document.execCommand("copy"));
      done.then(() => { button.textContent = "Copied"; }, () => { button.textContent = "Selected"; });
      setTimeout(() => { button.textContent = "Copy"; }, 2000);
    });
    block.append(button);
  }

  // plotly.js lies in the page compressed. Where it cannot be unpacked, or may not run, the still
  // figures remain.
  async function unpack(held) {
    const bytes = Uint8Array.from(atob(held.textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const code = document.createElement("script");
    code.textContent = await new Response(stream).text();
    held.replaceWith(code);
  }

  function begin() {
    // Figures in space need WebGL; the flat ones beside them say the same.
    root.classList.toggle("flat", !document.createElement("canvas").getContext("webgl"));
    plots.forEach(offer);
    draw();
    let width = window.innerWidth;
    window.addEventListener("resize", () => {
      if (window.innerWidth !== width) { width = window.innerWidth; draw(); }
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => draw());
    window.addEventListener("beforeprint", () => print(true));
    window.addEventListener("afterprint", () => print(false));
  }

  const held = document.getElementById("plotly");
  if (held && window.DecompressionStream) unpack(held).then(() => window.Plotly && begin(), console.error);
})();
