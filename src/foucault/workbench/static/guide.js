// What a guide keeps is shown: the body as it is held, the ring of a rest, bars, a sound at its end.
(function () {
  "use strict";
  const root = document.getElementById("guide");
  if (!root) return;
  const at = (id) => document.getElementById(id), place = "http://www.w3.org/2000/svg";
  const say = (id, text) => { if (at(id).textContent !== text) at(id).textContent = text; };
  const PERIOD = 200, LATE = 5;

  // -- sound --------------------------------------------------------------------------------
  let audio = null, sounds = null;
  at("sound").addEventListener("click", () => {
    const on = at("sound").getAttribute("aria-pressed") !== "true";
    at("sound").setAttribute("aria-pressed", on);
    say("sound", on ? "Sound is on" : "Sound on");
    if (on && !audio) audio = new AudioContext();
    if (on) { audio.resume(); beep(660); }
  });
  const beep = (pitch, later = 0) => {
    if (!audio || at("sound").getAttribute("aria-pressed") !== "true") return;
    const tone = audio.createOscillator(), loud = audio.createGain(), start = audio.currentTime + later;
    tone.frequency.value = pitch;
    loud.gain.setValueAtTime(0.3, start);
    loud.gain.exponentialRampToValueAtTime(0.001, start + 0.45);
    tone.connect(loud).connect(audio.destination);
    tone.start(start); tone.stop(start + 0.5);
    root.dataset.beeps = Number(root.dataset.beeps || 0) + 1;
  };

  // -- the body ------------------------------------------------------------------------------
  // Body axes are right, forward, up; those of the screen right, down, towards who looks.
  const swap = (v) => [v[0], -v[2], -v[1]];
  const turn = (id, C, heading) => {
    const c = Math.cos(heading), s = Math.sin(heading);
    const seen = [0, 1, 2].map((j) => {
      const v = [C[0][j], C[1][j], C[2][j]];
      return [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]];
    });
    const [x, y, z] = seen.map(swap); // images of right, forward, up
    const down = z.map((k) => -k), near = y.map((k) => -k);
    const all = [...x, 0, ...down, 0, ...near, 0, 0, 0, 0, 1].map((k) => k.toFixed(4));
    at(id).style.transform = `rotateX(-24deg) rotateY(-16deg) matrix3d(${all.join(",")})`;
  };

  // -- bars ----------------------------------------------------------------------------------
  const cell = (row, text, name) => { const one = row.insertCell(); one.textContent = text; one.className = name; return one; };
  const bars = (list) => {
    at("bars").hidden = !list.length;
    const rows = at("rows");
    if (rows.dataset.said === JSON.stringify(list)) return;
    rows.dataset.said = JSON.stringify(list);
    rows.replaceChildren(...list.map((one) => {
      const row = document.createElement("tr"), head = document.createElement("th");
      head.scope = "row"; head.append(document.createElement("code")); head.firstChild.textContent = one.name;
      row.append(head);
      const svg = document.createElementNS(place, "svg");
      svg.setAttribute("viewBox", "0 0 100 10"); svg.setAttribute("preserveAspectRatio", "none"); svg.setAttribute("aria-hidden", "true");
      // Logarithmic: what is wanted is in the middle, ten times that is full.
      const part = one.ratio === null ? 100 : Math.min(100, Math.max(2, 50 * (1 + Math.log10(Math.max(one.ratio, 1e-3)))));
      const box = (width, name) => { const r = document.createElementNS(place, "rect"); r.setAttribute("width", width); r.setAttribute("height", 10); if (name) r.setAttribute("class", name); svg.append(r); };
      box(100, ""); box(part, one.ratio !== null && one.ratio <= 1 ? "enough" : "full");
      const mark = document.createElementNS(place, "line");
      for (const [k, v] of [["x1", 50], ["x2", 50], ["y1", 0], ["y2", 10], ["vector-effect", "non-scaling-stroke"]]) mark.setAttribute(k, v);
      svg.append(mark);
      cell(row, "", "").append(...(one.wanted === "-" ? [] : [svg])); // of what is not wanted nothing lacks
      for (const key of ["reached", "after", "wanted"]) cell(row, one[key], key === "after" ? "number aside" : "number");
      return row;
    }));
  };

  // -- all of it -----------------------------------------------------------------------------
  const over = (state) => ["done", "failed", "stopped"].includes(state.job);
  const show = (state) => {
    root.className = state.phase;
    root.dataset.rows = state.rows || 0;
    if (state.phase === "wait" && !over(state)) say("task", "Waiting for a worker …");
    if (state.task) say("task", state.task);
    if (state.now) say("now", state.now);
    at("ring").setAttribute("stroke-dasharray", `${100 * (state.ring || 0)} 100`);
    say("rests", String(state.rests || 0));
    say("count", state.list ? `${state.list[0]} / ${state.list[1]}` : "");
    if (state.attitude) turn("held", state.attitude, state.heading);
    if (state.asked) turn("asked", state.asked, state.heading);
    at("asked-one").hidden = !state.asked; at("held-one").hidden = !state.attitude;
    const wrong = [...(state.troubles || []), ...(state.findings || []), ...(state.stopped ? [] : state.mistakes || []).slice(-2)];
    if (state.age > LATE && !over(state) && !state.stopped) wrong.unshift(`The guide has said nothing for ${state.age.toFixed(0)} s.`);
    if (at("wrong").dataset.said !== JSON.stringify(wrong)) {
      at("wrong").dataset.said = JSON.stringify(wrong);
      at("wrong").replaceChildren(...wrong.map((text) => { const one = document.createElement("li"); one.textContent = text; return one; }));
    }
    bars(state.bars || []);
    const heard = sounds === null ? state.sounds : sounds; // rests that ended since are told one after the other
    for (let k = heard; k < state.sounds; k++) beep(state.stopped ? 1320 : 880, 0.6 * (k - heard));
    sounds = state.sounds || 0;
    const word = over(state) ? (state.result || state.job) : (state.stopped && state.verdict) || "";
    at("verdict").hidden = !word;
    at("verdict").className = `verdict ${{ failed: "unusable", stopped: "unusable" }[word] || word}`;
    say("word", word.charAt(0).toUpperCase() + word.slice(1));
    at("result").hidden = !over(state); at("ends").hidden = over(state);
    at("said").hidden = !state.said; if (state.said) say("said", state.said);
  };
  const ask = async () => {
    let state = {};
    try {
      const answer = await fetch(root.dataset.state, { headers: { accept: "application/json" } });
      if (answer.ok) show(state = await answer.json());
    } catch { say("now", "The workbench does not answer."); }
    if (!over(state)) setTimeout(ask, PERIOD);
  };
  ask();
})();
