// Charts of a few curves: draws those of each group from the JSON beside them, with uPlot.
(() => {
  "use strict";
  const { dark, color, make, number, tick, decades, nearest } = jaxcal, charts = [];

  class Chart {
    constructor(data, where) {
      this.data = data;
      this.unit = data.units[0];
      [this.to, this.from] = data.log ? [Math.log10, (v) => 10 ** v] : [(v) => v, (v) => v];
      this.shown = new Set(data.curves.map((_, i) => i));
      this.names = [...new Set(data.curves.map((c) => c.name))];
      this.readout = make("p", { class: "readout small" });
      this.host = make("div", { class: "chart", tabindex: "0", role: "img", "aria-label": `${data.title}. Arrow keys read values, + and - zoom, 0 shows all.` });
      const act = (label, text, run) => make("button", { type: "button", "aria-label": `${label}, ${data.title}`, title: label, onclick: run }, text);
      const zoom = make("span", { class: "zoom" }, act("Zoom in", "+", () => this.by(0.5)), act("Zoom out", "−", () => this.by(2)), act("Show all", "↔", () => this.zoom(null)));
      where.append(make("figure", {}, make("div", { class: "title" }, make("b", {}, data.title), zoom), this.bar(), this.host, this.readout, make("figcaption", {}, data.about)));
      this.make();
      this.host.addEventListener("keydown", (event) => this.key(event));
      new ResizeObserver(() => { if (this.host.clientWidth && this.plot.width !== this.host.clientWidth) this.plot.setSize(this.size()); }).observe(this.host);
    }
    bar() {
      const data = this.data, bar = make("div", { class: "bar still" });
      const group = (name, ...parts) => bar.append(make("div", { class: "group", role: "group", "aria-label": name }, ...parts));
      if (this.names.length > 1) group("Curves", ...this.names.map((name) => {
        const own = data.curves.map((c, i) => [c, i]).filter(([c]) => c.name === name).map(([, i]) => i);
        const button = make("button", { type: "button", class: `toggle c${data.curves[own[0]].color % 6}`, "aria-pressed": "true" }, name);
        button.addEventListener("click", () => {
          const on = this.shown.has(own[0]);
          own.forEach((i) => (on ? this.shown.delete(i) : this.shown.add(i)));
          button.setAttribute("aria-pressed", String(!on));
          this.draw();
        });
        return button;
      }));
      if (data.units.length > 1) {
        const units = make("select", { "aria-label": `Unit of ${data.title}` }, ...data.units.map(([label], i) => make("option", { value: i }, label)));
        units.addEventListener("change", () => { this.unit = data.units[units.value]; this.draw(); });
        group("Unit", units);
      }
      const said = make("span", { role: "status", class: "small" });
      group("Copy", ...["CSV", "YAML", "JSON"].map((form) => make("button", { type: "button", onclick: () => this.copy(form, said, bar) }, form)), said);
      return bar;
    }
    size() { return { width: this.host.clientWidth || 320, height: Math.round(Math.min(Math.max((this.host.clientWidth || 320) * 0.5, 220), 360)) }; }
    scaled(values) { return values && values.map((v) => (v === null || (this.data.log && v <= 0) ? null : v / this.unit[1])); }
    label() { return this.unit[0] ? `${this.data.y} (${this.unit[0]})` : this.data.y; }
    make() {
      if (this.plot) this.plot.destroy();
      const ink = color("ink"), grid = color("grid"), font = "12px system-ui, sans-serif";
      const axis = (label) => ({ label, ...(this.data.log ? { splits: decades, filter: (u, splits) => splits } : {}), stroke: ink, font, labelFont: font, labelSize: 18, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1, size: 4 }, values: (u, splits) => splits.map((v) => tick(v)) });
      const counted = this.data.curves.every((curve) => curve.x.every(Number.isInteger)); // no half poses among the ticks
      this.plot = new uPlot({
        ...this.size(), padding: [10, 20, 0, 0], legend: { show: false },
        scales: Object.fromEntries(["x", "y"].map((name) => [name, { time: false, auto: name === "x", distr: this.data.log ? 3 : 1, range: (u, low, high) => [low, high] }])),
        axes: [{ ...axis(this.data.x), space: 45, size: 34, ...(counted ? { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] } : {}) }, { ...axis(this.label()), size: 66, space: 28 }],
        series: [{}, { show: true, paths: () => null, points: { show: false } }],
        cursor: { drag: { x: true, y: false, uni: 8 }, points: { show: false } },
        hooks: {
          draw: [(u) => this.over(u)], setCursor: [(u) => this.say(u.cursor.left >= 0 ? u.posToVal(u.cursor.left, "x") : null)],
          setSelect: [(u) => { if (u.select.width > 5) this.zoom([u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")]); }],
        },
      }, [this.ends(), this.ends().map(() => null)], this.host);
      this.plot.over.addEventListener("dblclick", () => this.zoom(null));
      this.zoom(this.window || null);
      this.say(null);
    }
    visible() { return this.data.curves.filter((_, i) => this.shown.has(i)); }
    ends() {
      const xs = this.data.curves.flatMap((c) => c.x).map(this.to), low = Math.min(...xs), high = Math.max(...xs), room = (high - low || 1) * 0.02;
      return [this.from(low - room), this.from(high + room)];
    }
    reach() {
      const [min, max] = this.window;
      const seen = this.visible().flatMap((c) => c.x.flatMap((x, i) => (x >= min && x <= max ? [c.y[i], ...(c.low ? [c.low[i], c.high[i]] : [])] : [])));
      const ys = this.scaled(seen.filter((v) => v !== null)).filter((v) => v !== null).map(this.to);
      if (!ys.length) return this.data.log ? [0.1, 10] : [-1, 1];
      const high = Math.max(...ys), low = Math.max(Math.min(...ys), this.data.log ? high - 8 : -Infinity); // no more than eight decades
      const room = (high - low || Math.abs(high) || 1) * 0.06;
      return [this.from(low - room), this.from(high + room)];
    }
    draw() {
      this.plot.axes[1].label = this.label();
      this.zoom(this.window);
      this.say(null);
    }
    zoom(range) {
      const [low, high] = this.ends();
      let [a, b] = range || [low, high];
      [a, b] = [Math.max(a, low), Math.min(b, high)];
      if (this.to(b) - this.to(a) < (this.to(high) - this.to(low)) / 500) return;
      this.window = [a, b];
      const [bottom, top] = this.reach();
      this.plot.batch(() => {
        this.plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        this.plot.setScale("x", { min: a, max: b });
        this.plot.setScale("y", { min: bottom, max: top });
        this.plot.redraw(false, true);
      });
    }
    by(factor) {
      const { min, max } = this.plot.scales.x, left = this.plot.cursor.left;
      const [a, b] = [min, max].map(this.to), middle = left >= 0 ? this.to(this.plot.posToVal(left, "x")) : (a + b) / 2;
      this.zoom([this.from(middle - (middle - a) * factor), this.from(middle + (b - middle) * factor)]);
    }
    key(event) {
      const u = this.plot, step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (step) {
        const xs = [...new Set(this.visible().flatMap((c) => c.x))].sort((a, b) => a - b).filter((x) => x >= u.scales.x.min && x <= u.scales.x.max);
        if (!xs.length) return;
        const i = u.cursor.left >= 0 ? nearest(xs, u.posToVal(u.cursor.left, "x"), false) + step : 0;
        u.setCursor({ left: u.valToPos(xs[Math.min(Math.max(i, 0), xs.length - 1)], "x"), top: 10 });
      } else if (event.key === "+") this.by(0.5);
      else if (event.key === "-") this.by(2);
      else if (event.key === "0") this.zoom(null);
      else return;
      event.preventDefault();
    }
    say(x) {
      if (x === null) { this.readout.textContent = "Move over the chart, or tap it, to read values; drag to zoom."; return; }
      let at = x;
      const unit = this.unit[0] && ` ${this.unit[0]}`, parts = this.visible().map((c) => {
        const i = nearest(c.x, x, false), value = c.y[i];
        if (c.kind === "dots") at = c.x[i];
        const limits = c.low && c.low[i] !== null ? ` (${number(c.low[i] / this.unit[1])} to ${number(c.high[i] / this.unit[1])})` : "";
        const words = value === null ? "missing" : `${number(value / this.unit[1], 4)}${limits}${unit}`;
        return make("span", { class: `c${c.color % 6}` }, make("b", {}, c.label || c.name), ` ${words}`);
      });
      this.readout.replaceChildren(make("span", {}, `${this.data.x}: ${number(at, 4)}`), ...parts.flatMap((part) => [" ", part]));
    }
    over(u) {
      const { left, top, width, height } = u.bbox, ctx = u.ctx, ratio = devicePixelRatio;
      const at = (x, y) => [u.valToPos(x, "x", true), u.valToPos(y, "y", true)];
      ctx.save();
      ctx.beginPath();
      ctx.rect(left, top, width, height);
      ctx.clip();
      ctx.strokeStyle = color("muted");
      ctx.lineWidth = ratio;
      for (const x of this.data.marks) { const [a] = at(x, 0); ctx.setLineDash([3 * ratio, 3 * ratio]); ctx.beginPath(); ctx.moveTo(a, top); ctx.lineTo(a, top + height); ctx.stroke(); }
      ctx.setLineDash([]);
      for (const c of this.visible()) {
        const ys = this.scaled(c.y), low = this.scaled(c.low), high = this.scaled(c.high);
        ctx.strokeStyle = ctx.fillStyle = color(`series-${c.color % 6}`);
        if (c.kind === "line") {
          if (low) {
            ctx.globalAlpha = 0.2;
            ctx.beginPath();
            c.x.forEach((x, i) => ctx.lineTo(...at(x, high[i])));
            [...c.x.keys()].reverse().forEach((i) => ctx.lineTo(...at(c.x[i], low[i])));
            ctx.fill();
            ctx.globalAlpha = 1;
          }
          ctx.lineWidth = 2 * ratio;
          ctx.beginPath();
          let pen = false;
          c.x.forEach((x, i) => {
            if (ys[i] === null) { pen = false; return; }
            if (pen) ctx.lineTo(...at(x, ys[i])); else ctx.moveTo(...at(x, ys[i]));
            pen = true;
          });
          ctx.stroke();
        } else c.x.forEach((x, i) => {
          if (ys[i] === null) return;
          ctx.lineWidth = 1.2 * ratio;
          if (low && low[i] !== null) { ctx.beginPath(); ctx.moveTo(...at(x, low[i])); ctx.lineTo(...at(x, high[i])); ctx.stroke(); }
          ctx.beginPath();
          ctx.arc(...at(x, ys[i]), (c.x.length > 60 ? 1.8 : 3.5) * ratio, 0, 7);
          if (c.hollow && c.hollow.includes(i)) { ctx.save(); ctx.fillStyle = color("paper"); ctx.fill(); ctx.restore(); ctx.stroke(); } else ctx.fill();
        });
      }
      ctx.restore();
    }
    // the curves that are shown, in the chosen unit
    rows() {
      const round = (v) => (v === null || v === undefined ? null : Number((v / this.unit[1]).toPrecision(6)));
      return this.visible().flatMap((c) => c.x.map((x, i) => ({ curve: c.label || c.name, [this.data.x]: x, value: round(c.y[i]), low: round(c.low && c.low[i]), high: round(c.high && c.high[i]), unit: this.unit[0] })));
    }
    text(form) {
      const rows = this.rows(), plain = (v) => (v === null ? (form === "YAML" ? "null" : "") : typeof v === "number" ? String(v) : form === "YAML" ? JSON.stringify(v) : /[",\n]/.test(v) ? `"${v.replace(/"/g, '""')}"` : v);
      if (form === "JSON") return JSON.stringify(rows, null, 1);
      if (form === "YAML") return rows.map((row) => `- {${Object.entries(row).map(([k, v]) => `${JSON.stringify(k)}: ${plain(v)}`).join(", ")}}`).join("\n") + "\n";
      return [Object.keys(rows[0] || {}).map(plain).join(","), ...rows.map((row) => Object.values(row).map(plain).join(","))].join("\n") + "\n";
    }
    async copy(form, said, bar) {
      const text = this.copied = this.text(form), old = bar.querySelector("textarea");
      if (old) old.remove();
      try {
        await navigator.clipboard.writeText(text);
        said.textContent = `copied as ${form}`;
      } catch {  // a browser that lets no page write there: the text to be copied by hand
        const area = make("textarea", { "aria-label": `${this.data.title} as ${form}`, readonly: "", rows: "6" });
        area.value = text;
        bar.append(area);
        area.select();
        said.textContent = "copy the text below";
      }
    }
  }

  for (const root of document.querySelectorAll(".charts")) {
    const live = make("div", { class: "live-part" }), views = make("div", { class: "views" });
    live.append(views);
    root.append(live);
    root.classList.add("live");
    for (const data of JSON.parse(root.querySelector("script").textContent)) charts.push(new Chart(data, views));
  }
  dark.addEventListener("change", () => charts.forEach((chart) => chart.make()));
})();
