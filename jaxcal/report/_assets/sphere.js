// The sphere of a magnetometer's readings, and that of a device's axes during a recording, which turn under the finger.
(() => {
  "use strict";
  const html = document.documentElement;
  const color = (name) => getComputedStyle(html).getPropertyValue(`--${name}`).trim();
  const make = (tag, attributes = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.append(...children);
    return element;
  };
  const number = (value, digits = 3) => String(Number(value.toPrecision(digits)));
  const product = (a, b) => a.map((row) => [0, 1, 2].map((j) => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]));
  const spin = (axis, angle) => {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    return axis === "x" ? [[1, 0, 0], [0, c, -s], [0, s, c]] : axis === "y" ? [[c, 0, s], [0, 1, 0], [-s, 0, c]] : [[c, -s, 0], [s, c, 0], [0, 0, 1]];
  };

  class Sphere {
    constructor(root) {
      this.data = JSON.parse(root.querySelector("script").textContent);
      this.view = product(spin("x", -1.2), spin("z", -2.2));  // x right and towards us, z up
      this.shown = { "as measured": false, residuals: true, "missing directions": true };
      this.canvas = make("canvas", { tabindex: "0", role: "img", "aria-label": `${this.title()} on a sphere. Arrow keys turn it.` });
      this.readout = make("p", { class: "readout small" });
      const live = make("div", { class: "live-part" }, this.bar(), make("figure", {}, this.canvas, this.readout, make("figcaption", {}, this.about())));
      root.querySelector(".static").after(live);
      root.classList.add("live");
      const sizes = this.data.residual ? this.data.residual.map(Math.abs).sort((a, b) => a - b) : [1];
      this.limit = sizes[Math.floor(0.95 * (sizes.length - 1))] || 1;
      this.turning();
      new ResizeObserver(() => this.draw()).observe(live);
      this.say(null);
      this.draw();
    }
    title() { return "Directions of the corrected readings"; }
    names() { return ["x", "y", "z"]; }
    about() { return "Drag to turn. Dots: readings, faint where they are behind. Their colour is the residual: orange outside of the field's sphere, blue inside. Hollow rings: directions without a reading; crosses: readings would help most here."; }
    bar() {
      return make("div", { class: "bar" }, make("div", { class: "group", role: "group", "aria-label": "Shown" }, ...Object.keys(this.shown).map((name) => {
        const button = make("button", { type: "button", class: "toggle", "aria-pressed": String(this.shown[name]) }, name);
        button.addEventListener("click", () => {
          this.shown[name] = !this.shown[name];
          button.setAttribute("aria-pressed", String(this.shown[name]));
          this.draw();
        });
        return button;
      })));
    }
    turning() {
      const canvas = this.canvas;
      let last = null;
      canvas.addEventListener("pointerdown", (e) => { last = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
      canvas.addEventListener("pointermove", (e) => {
        if (!last) { this.say(this.nearest(e.offsetX, e.offsetY)); return; }
        this.turn((e.clientX - last[0]) / this.radius, (e.clientY - last[1]) / this.radius);
        last = [e.clientX, e.clientY];
      });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => { last = null; this.say(this.nearest(e.offsetX, e.offsetY)); });
      canvas.addEventListener("keydown", (e) => {
        const by = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, -0.15], ArrowDown: [0, 0.15] }[e.key];
        if (by) { this.turn(...by); e.preventDefault(); }
      });
    }
    turn(across, down) {
      this.view = product(product(spin("y", across), spin("x", down)), this.view);
      this.draw();
    }
    // right, up and towards us
    seen([x, y, z]) { return this.view.map((row) => row[0] * x + row[1] * y + row[2] * z); }
    place(v) { const [a, b, c] = this.seen(v); return [this.middle[0] + a * this.radius, this.middle[1] - b * this.radius, c]; }
    nearest(x, y) {
      let best = null, least = 14 ** 2;
      this.data.readings.forEach((v, i) => {
        const [a, b, c] = this.place(v), apart = (a - x) ** 2 + (b - y) ** 2;
        if (c > 0 && apart < least) [best, least] = [i, apart];
      });
      return best;
    }
    say(i) {
      const d = this.data;
      if (i === null) { this.readout.textContent = d.readings.length ? "Move over a reading, or tap it, to read its residual." : "The readings are not at hand; rings show directions without one."; return; }
      const [x, y, z] = d.readings[i], size = Math.hypot(x, y, z), outlier = d.outliers[i] ? ", an outlier" : "";
      const degrees = (v) => number((v * 180) / Math.PI, 3);
      this.readout.textContent = `Reading ${d.number[i]}: longitude ${degrees(Math.atan2(y, x))}°, latitude ${degrees(Math.asin(z / size))}°, residual ${number(d.residual[i])} ${d.unit} of a field of ${d.field} ${d.unit}${outlier}`;
    }
    path(points) {
      const ctx = this.ctx;
      for (const front of [false, true]) {
        ctx.globalAlpha = front ? 1 : 0.3;
        ctx.beginPath();
        let pen = false;
        points.forEach((v) => {
          const [a, b, c] = this.place(v), here = c >= 0 === front;
          if (here && pen) ctx.lineTo(a, b); else if (here) ctx.moveTo(a, b);
          pen = here;
        });
        ctx.stroke();
      }
      ctx.globalAlpha = 1;
    }
    draw() {
      const wide = Math.min(this.canvas.parentElement.clientWidth || 320, 560), tall = Math.min(wide, innerWidth < 576 ? 240 : 440), ratio = devicePixelRatio || 1;
      this.canvas.width = wide * ratio;
      this.canvas.height = tall * ratio;
      this.canvas.style.width = `${wide}px`;
      this.canvas.style.height = `${tall}px`;
      const ctx = (this.ctx = this.canvas.getContext("2d"));
      ctx.scale(ratio, ratio);
      this.middle = [wide / 2, tall / 2];
      this.radius = Math.min(wide, tall) * 0.4;
      const circle = Array.from({ length: 73 }, (_, k) => [Math.cos((k * Math.PI) / 36), Math.sin((k * Math.PI) / 36)]);
      ctx.lineWidth = 1;
      ctx.strokeStyle = color("line");
      for (const z of [-0.866, -0.5, 0, 0.5, 0.866]) this.path(circle.map(([a, b]) => [a * Math.sqrt(1 - z * z), b * Math.sqrt(1 - z * z), z]));
      for (let k = 0; k < 6; k++) {
        const [c, s] = [Math.cos((k * Math.PI) / 6), Math.sin((k * Math.PI) / 6)];
        this.path(circle.map(([a, b]) => [a * c, a * s, b]));
      }
      ctx.strokeStyle = color("muted");
      ctx.beginPath();
      ctx.arc(...this.middle, this.radius, 0, 2 * Math.PI);
      ctx.stroke();
      this.axes(ctx);
      this.points(ctx);
      if (this.shown["missing directions"]) this.gaps(ctx);
    }
    axes(ctx) {
      ctx.font = "bold 13px system-ui, sans-serif";
      ctx.textAlign = "center";
      ctx.textBaseline = "middle";
      this.names().forEach((name, k) => {
        const v = [0, 0, 0];
        v[k] = 1;
        this.arm(ctx, v, name, color("ink"));
      });
    }
    arm(ctx, v, name, ink) {
      const [a, b, c] = this.place(v), [p, q] = this.place(v.map((one) => 1.14 * one));
      ctx.globalAlpha = c >= 0 ? 1 : 0.45;
      ctx.strokeStyle = ctx.fillStyle = ink;
      ctx.beginPath();
      ctx.moveTo(...this.middle);
      ctx.lineTo(a, b);
      ctx.stroke();
      ctx.fillText(name, p, q);
      ctx.globalAlpha = 1;
    }
    points(ctx) {
      const d = this.data, blue = color("series-0"), orange = color("series-1"), plain = color("muted");
      const order = d.readings.map((v, i) => [...this.place(v), i]).sort((a, b) => a[2] - b[2]);
      for (const [a, b, c, i] of order) {
        const share = this.shown.residuals ? Math.min(Math.abs(d.residual[i]) / this.limit, 1) : 0;
        ctx.globalAlpha = (c >= 0 ? 1 : 0.3) * (this.shown.residuals ? 0.35 + 0.65 * share : 0.8);
        ctx.fillStyle = this.shown.residuals ? (d.residual[i] > 0 ? orange : blue) : plain;
        ctx.beginPath();
        ctx.arc(a, b, 2 + 2 * share, 0, 2 * Math.PI);
        ctx.fill();
      }
      if (this.shown["as measured"]) for (const v of d.measured || []) {
        const [a, b, c] = this.place(v);
        ctx.globalAlpha = c >= 0 ? 0.8 : 0.25;
        ctx.fillStyle = color("series-2");
        ctx.fillRect(a - 1.5, b - 1.5, 3, 3);
      }
      ctx.globalAlpha = 1;
    }
    gaps(ctx) {
      ctx.lineWidth = 1.5;
      for (const v of this.data.missing) {
        const [a, b, c] = this.place(v);
        ctx.globalAlpha = c >= 0 ? 0.9 : 0.2;
        ctx.strokeStyle = color("series-4");
        ctx.beginPath();
        ctx.arc(a, b, 6, 0, 2 * Math.PI);
        ctx.stroke();
      }
      for (const v of this.data.needed) {
        const [a, b, c] = this.place(v);
        ctx.globalAlpha = c >= 0 ? 1 : 0.3;
        ctx.strokeStyle = color("series-1");
        ctx.lineWidth = 3;
        ctx.beginPath();
        for (const s of [-1, 1]) { ctx.moveTo(a - 6, b - 6 * s); ctx.lineTo(a + 6, b + 6 * s); }
        ctx.stroke();
      }
      ctx.globalAlpha = 1;
    }
  }
  class Replay extends Sphere {
    title() { return "Axes of the device"; }
    names() { return ["north", "west", "up"]; }
    about() { return "The axes of the device during the recording, with the way of its x axis over the last seconds. Drag to turn."; }
    bar() {
      this.at = 0;
      this.slider = make("input", { type: "range", min: "0", max: String(this.data.time.length - 1), value: "0", "aria-label": "Time of the recording" });
      this.slider.addEventListener("input", () => this.go(Number(this.slider.value)));
      this.button = make("button", { type: "button" }, "play");
      this.button.addEventListener("click", () => this.play(!this.clock));
      return make("div", { class: "bar still" }, this.button, this.slider);
    }
    play(on) {
      clearInterval(this.clock);
      const last = this.data.time.length - 1;
      if (on && this.at === last) this.go(0);
      this.clock = on ? setInterval(() => (this.at < last ? this.go(this.at + 1) : this.play(false)), 60) : null;
      this.button.textContent = on ? "pause" : "play";
    }
    go(at) {
      this.at = at;
      this.slider.value = String(at);
      this.say(null);
      this.draw();
    }
    nearest() { return null; }
    say() { this.readout.textContent = `${number(this.data.time[this.at], 4)} s`; }
    axis(i, k) { return [0, 1, 2].map((row) => this.data.frames[i][3 * row + k]); }
    points(ctx) {
      ctx.strokeStyle = color("series-0");
      ctx.lineWidth = 1.5;
      this.path(Array.from({ length: Math.min(this.at, 20) + 1 }, (_, back) => this.axis(this.at - back, 0)));
      ctx.lineWidth = 4;
      ["x", "y", "z"].forEach((name, k) => this.arm(ctx, this.axis(this.at, k), name, color(`series-${k}`)));
    }
    gaps() {}
  }
  const made = (root) => new (root.classList.contains("replay") ? Replay : Sphere)(root);
  const spheres = [...document.querySelectorAll(".sphere")].map((root) => (root.sphere = made(root)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => spheres.forEach((one) => one.draw()));
})();
