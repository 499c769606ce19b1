// The edges of rests are dragged on their traces; without this they are written into the table.
(function () {
  "use strict";
  const form = document.querySelector("form[data-rests]");
  if (!form) return;
  const end = Number(form.dataset.rests), svg = form.querySelector("svg");
  const body = form.querySelector("tbody"), place = "http://www.w3.org/2000/svg";
  const width = 4;
  const rows = () => [...body.rows].map((row) => [...row.querySelectorAll("input")]);
  const draw = () => {
    svg.querySelectorAll("rect").forEach((one) => one.remove());
    rows().forEach(([first, last, out]) => {
      const a = parseFloat(first.value), b = parseFloat(last.value);
      if (!(b > a) || out.checked) return;
      const box = (x, wide, input) => {
        const one = document.createElementNS(place, "rect");
        for (const [key, value] of [["x", x], ["width", wide], ["y", 0], ["height", 100]])
          one.setAttribute(key, value);
        if (input) { one.setAttribute("class", "edge"); one.addEventListener("pointerdown", (event) => drag(event, input)); }
        svg.insertBefore(one, input ? null : svg.firstChild);
      };
      box(1000 * a / end, 1000 * (b - a) / end);
      box(1000 * a / end - width / 2, width, first);
      box(1000 * b / end - width / 2, width, last);
    });
  };
  const time = (event) => {
    const box = svg.getBoundingClientRect();
    return Math.min(end, Math.max(0, end * (event.clientX - box.left) / box.width));
  };
  const drag = (event, input) => {
    event.preventDefault();
    svg.setPointerCapture(event.pointerId); // wherever it goes: each edge is drawn anew on the way
    const move = (at) => { if (at.pointerId === event.pointerId) { input.value = time(at).toFixed(3); draw(); } };
    const stop = (at) => {
      if (at.pointerId !== event.pointerId) return;
      svg.removeEventListener("pointermove", move);
      for (const end of ["pointerup", "pointercancel"]) svg.removeEventListener(end, stop);
    };
    svg.addEventListener("pointermove", move);
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, stop);
  };
  svg.addEventListener("dblclick", (event) => {
    const empty = rows().find(([first]) => !first.value);
    const [first, last] = empty || (() => {
      const row = body.lastElementChild.cloneNode(true);
      row.querySelector("[type=checkbox]").value = body.rows.length;
      body.append(row);
      return [...row.querySelectorAll("input")];
    })();
    const at = time(event);
    first.value = Math.max(0, at - end / 200).toFixed(3);
    last.value = Math.min(end, at + end / 200).toFixed(3);
    draw();
  });
  body.addEventListener("input", draw);
  draw();
})();
