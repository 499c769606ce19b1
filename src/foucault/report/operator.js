// Turns the large picture from position to position; all of them are in the page without it.
(function () {
  "use strict";
  const figure = document.querySelector(".turner"), svg = figure.querySelector("svg");
  const {view, half, at: [tip, name, ring, along], stages} = JSON.parse(document.getElementById("motion").textContent);
  const ground = [...svg.querySelectorAll(".ground, .way")].map((one) => one.outerHTML).join("");
  const told = document.getElementById("told"), cards = [...document.querySelectorAll("ol > li")];
  const play = figure.querySelector("[data-play]");
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const times = (A, B) => A.map((row) => [0, 1, 2].map((j) => row[0] * B[0][j] + row[1] * B[1][j] + row[2] * B[2][j]));
  const by = (A, v) => A.map((row) => dot(row, v));
  const point = (v) => v.slice(0, 2).map((one) => one.toFixed(3)).join(",");
  const turn = (w) => {  // rotation by the vector w
    const angle = Math.hypot(...w), u = angle ? w.map((x) => x / angle) : [0, 0, 1];
    const c = Math.cos(angle), s = Math.sin(angle);
    const K = [[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]];
    return K.map((row, i) => row.map((k, j) => (i === j ? c : 0) + s * k + (1 - c) * u[i] * u[j]));
  };
  const vector = (C) => {  // of the rotation C, half a turn included
    const s = [C[2][1] - C[1][2], C[0][2] - C[2][0], C[1][0] - C[0][1]];
    const sine = Math.hypot(...s) / 2, angle = Math.atan2(sine, (C[0][0] + C[1][1] + C[2][2] - 1) / 2);
    if (sine > 1e-4) return s.map((x) => x * angle / (2 * sine));
    if (angle < 1) return [0, 0, 0];
    const d = [0, 1, 2].map((i) => Math.max(0, (C[i][i] + 1) / 2)), k = d.indexOf(Math.max(...d));
    return [0, 1, 2].map((i) => Math.PI * (i === k ? Math.sqrt(d[k]) : (C[i][k] + C[k][i]) / 4 / Math.sqrt(d[k])));
  };
  const at = (v, far) => [v[0] * far, v[1] * far].map((one) => one.toFixed(3));
  const axis = (k, v) => {
    const [x, y] = at(v, half[k]), [u, w] = at(v, tip);
    return `<line class="axis${k + 1}" x1="${x}" y1="${y}" x2="${u}" y2="${w}"/>`;
  };
  const letter = (k, v) => {
    const [x, y] = at(v, name);
    return `<text class="axis${k + 1}" x="${x}" y="${y}">${"xyz"[k]}</text>`;
  };
  const arrow = (u) => {
    const least = u.map(Math.abs), k = least.indexOf(Math.min(...least));
    let p = cross(u, [0, 1, 2].map((i) => (i === k ? 1 : 0)));
    p = p.map((x) => x / Math.hypot(...p));
    const q = cross(u, p);
    const far = dot(view[2], u) >= 0 ? along : -along;
    const on = (a, r) => by(view, [0, 1, 2].map((i) => far * u[i] + r * ring * (Math.cos(a) * p[i] + Math.sin(a) * q[i])));
    const arc = [...Array(27).keys()].map((n) => point(on(n * 0.2, 1))).join(" ");
    const head = [on(5.75, 1), on(5.2, 1.45), on(5.2, 0.55)].map(point).join(" ");
    return `<polyline class="turns" points="${arc}"/><polygon class="turned" points="${head}"/>`;
  };
  const draw = (C, w) => {
    const seen = times(view, C), column = (k) => seen.map((row) => row[k]), near = seen[2];
    const rate = Math.hypot(...w);
    let out = ground;
    for (const k of [0, 1, 2]) if (!(near[k] > 0)) out += axis(k, column(k));
    for (const k of [0, 1, 2]) for (const sign of [1, -1]) if (sign * near[k] > 0) {
      const [u, v, t] = [k, (k + 1) % 3, (k + 2) % 3].map((n) => column(n).map((x) => x * half[n]));
      const corners = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => point(u.map((x, i) => sign * x + a * v[i] + b * t[i])));
      out += `<polygon class="axis${k + 1}${sign > 0 ? "" : " back"}" points="${corners.join(" ")}"/>`;
    }
    for (const k of [0, 1, 2]) if (near[k] > 0) out += axis(k, column(k));
    if (rate) out += arrow(by(C, w.map((x) => x / rate)));
    svg.innerHTML = out + [0, 1, 2].map((k) => letter(k, column(k))).join("");
  };
  let now = 0, C = stages[0].C, running = 0, playing = false;
  const say = (k) => {
    told.textContent = `${k + 1} of ${stages.length}: ${stages[k].set}`;
    for (const act of stages[k].acts.slice(0, 3)) {
      const line = document.createElement("small");
      line.textContent = act.words;
      told.append(line);
    }
    cards.forEach((one, n) => one.toggleAttribute("aria-current", n === k));
  };
  // From C0 by the vector w in so many milliseconds.
  const slide = (C0, w, shown, length) => new Promise((done) => {
    const mine = ++running, start = performance.now();
    const frame = (time) => {
      if (mine !== running) return done(false);
      const part = Math.min(1, Math.max(0, (time - start) / length)), soft = part * part * (3 - 2 * part);
      C = times(C0, turn(w.map((x) => x * soft)));
      draw(C, shown);
      if (part < 1) requestAnimationFrame(frame); else done(true);
    };
    requestAnimationFrame(frame);
  });
  const transposed = (A) => A[0].map((_, j) => A.map((row) => row[j]));
  const to = async (goal, shown, length) => {
    const ended = calm.matches ? true : await slide(C, vector(times(transposed(C), goal)), shown, length);
    if (ended) { C = goal; draw(C, shown); }
    return ended;
  };
  const wait = (length) => new Promise((done) => { const mine = ++running; setTimeout(() => done(mine === running), length); });
  const show = async (k) => {
    now = Math.min(stages.length - 1, Math.max(0, k));
    say(now);
    if (calm.matches) { running++; return to(stages[now].C, stages[now].w, 0); }
    return to(stages[now].C, stages[now].w, 700);
  };
  const stop = () => { playing = false; running++; play.textContent = "Play"; };
  const run = async () => {
    playing = true;
    play.textContent = "Stop";
    for (let k = now === stages.length - 1 ? 0 : now; playing && k < stages.length; k++) {
      now = k;
      say(k);
      for (const act of stages[k].acts) {
        if (!playing || !(await to(act.C, act.w, 500))) return stop();
        const angle = act.w.map((x) => x * act.time), whole = Math.hypot(...angle);
        if (whole && !calm.matches) {  // at most one turn is seen of many
          const part = whole > 2 * Math.PI ? 2 * Math.PI / whole : 1;
          if (!(await slide(act.C, angle.map((x) => x * part), act.w, 1800))) return stop();
        } else if (!(await wait(calm.matches ? 1500 : 700))) return stop();
      }
    }
    stop();
  };
  figure.querySelectorAll("[data-step]").forEach((one) => one.addEventListener("click", () => { stop(); show(now + Number(one.dataset.step)); }));
  play.addEventListener("click", () => { if (playing) { stop(); show(now); } else run(); });
  figure.addEventListener("keydown", (event) => {
    const step = {ArrowLeft: -1, ArrowRight: 1}[event.key];
    if (step) { event.preventDefault(); stop(); show(now + step); }
    if (event.key === " " && event.target === figure) { event.preventDefault(); play.click(); }
  });
  figure.hidden = false;
  say(0);
  draw(C, stages[0].w);
})();
