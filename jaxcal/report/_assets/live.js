// The page of a recording in progress: it asks for the state ten times a second.
(() => {
  "use strict";
  const root = document.querySelector(".sphere"), say = (name, text) => { document.getElementById(name).textContent = text; };
  const stop = document.getElementById("stop");
  stop.addEventListener("click", () => { stop.disabled = true; fetch("stop", { method: "POST" }); });
  const ended = () => { stop.disabled = true; say("turn", "The recording has ended. The terminal has the answer."); };
  const look = async () => {
    let state;
    try { state = await (await fetch("state")).json(); } catch { ended(); return; }
    say("count", String(state.count));
    say("error", state.error === undefined || state.error === null ? "not known yet" : `${Number(state.error.toPrecision(2))}°`);
    say("reason", state.reason);
    if (state.sphere) {
      Object.assign(root.sphere.data, state.sphere);
      const sizes = state.sphere.residual.map(Math.abs).sort((a, b) => a - b);
      root.sphere.limit = sizes[Math.floor(0.95 * (sizes.length - 1))] || 1;
      root.sphere.say(null);
      root.sphere.draw();
    }
    if (state.done) ended(); else setTimeout(look, 100);
  };
  look();
})();
