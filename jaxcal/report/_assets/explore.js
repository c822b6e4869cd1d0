// The views of a report: draws the curves of each sensor from the JSON beside them, with uPlot.
(() => {
  "use strict";
  const { dark, color, make, number, interval, tick, decades, nearest } = jaxcal;
  const explorers = [], zooms = {};  // kind of abscissa -> [low, high] that is shown

  // the views: what they show, of which channel which curve
  const VIEWS = {
    allan: {
      kind: "tau", logX: true, logY: true, x: (d) => "Cluster time τ (s)", y: (e) => `${e.data.deviation} (${[e.unit.label, e.data.phase ? "s" : ""].filter(Boolean).join(" ") || "1"})`,
      title: (d) => d.deviation, scale: (e) => e.unit.scale, at: (c, e) => e.grid(c.allan.tau), values: (c) => c.allan.value,
      about: (d) => `Points: measured, with ${d.level} % intervals.`, name: (x) => `τ = ${number(x)} s`,
      limits: (c, i) => [c.allan.low[i], c.allan.high[i]],
    },
    spectrum: {
      kind: "f", logX: true, logY: true, x: () => "Frequency (Hz)", y: (e) => `Density (${/[/ ]/.test(e.unit.label) ? `(${e.unit.label})` : e.unit.label}²/Hz)`,
      title: () => "Spectrum", scale: (e) => e.unit.scale ** 2, at: (c, e) => e.grid(c.spectrum.f), values: (c) => c.spectrum.value,
      about: (d) => `${d.sided === 1 ? "One" : "Two"}-sided density, averaged.`, name: (x) => `f = ${number(x)} Hz`,
      limits: (c, i, e) => [c.spectrum.value[i] / e.grid(c.spectrum.upper)[i], c.spectrum.value[i] / e.grid(c.spectrum.lower)[i]],
    },
    residual: {
      kind: "f", logX: true, logY: true, x: () => "Frequency (Hz)", y: () => "Measured over fitted density",
      title: () => "Residual of the fit", scale: () => 1, at: (c, e) => e.grid(c.spectrum.f), values: (c) => c.spectrum.ratio,
      about: (d) => `Shaded: ${d.level} % of the values, were the model true.`, name: (x) => `f = ${number(x)} Hz`,
      limits: (c, i, e) => [e.grid(c.spectrum.lower)[i], e.grid(c.spectrum.upper)[i]],
    },
    signal: {
      kind: "t", logX: false, logY: false, x: () => "Time (s)", y: (e) => `Difference from the mean (${e.unit.label})`,
      title: () => "Signal", scale: (e) => e.unit.scale, at: (c, e) => e.grid(c.signal.t), values: (c) => c.signal.real.mean,
      about: (d) => "Mean of each stretch; shaded: its lowest to its highest value.", name: (x) => `t = ${number(x, 4)} s`,
      limits: (c, i) => [c.signal.real.low[i], c.signal.real.high[i]],
    },
  };
  const has = { allan: (c) => c.allan, spectrum: (c) => c.spectrum, residual: (c) => c.spectrum && c.spectrum.ratio, signal: (c) => c.signal };

  class Explorer {
    constructor(root) {
      this.root = root;
      this.data = JSON.parse(root.querySelector("script").textContent);
      this.channels = this.data.channels;
      this.channels.forEach((c, i) => {
        c.index = i;
        if (c.signal) {
          const real = (values) => values.map((v) => (v === null ? null : v * c.signal.step));
          c.signal.real = { low: real(c.signal.low), mean: real(c.signal.mean), high: real(c.signal.high) };
        }
      });
      this.terms = [...new Set(this.channels.flatMap((c) => Object.keys((c.allan && c.allan.model && c.allan.model.terms) || {})))];
      this.fitted = this.channels.some((c) => c.terms);
      this.shown = new Set(this.channels.map((c) => c.index));
      this.lines = new Set(["fit", ...this.terms]);
      this.unit = this.data.units[0];
      this.live = make("div", { class: "live-part" });
      this.live.append(this.bar());
      const views = make("div", { class: "views" });
      this.live.append(views);
      root.append(this.live);
      root.classList.add("live");
      this.views = Object.keys(VIEWS).filter((name) => this.channels.some(has[name])).map((name) => new View(this, name, views));
    }
    grid(values) { return typeof values === "number" ? this.data.grids[values] : values; }
    color(c) { return color(`series-${c.index % 6}`); }

    toggle(text, set, key, kind) {
      const button = make("button", { type: "button", "aria-pressed": String(set.has(key)), class: `toggle ${kind}` }, text);
      button.addEventListener("click", () => {
        if (set.has(key)) set.delete(key); else set.add(key);
        button.setAttribute("aria-pressed", String(set.has(key)));
        this.draw();
      });
      return button;
    }
    bar() {
      const group = (name, ...parts) => make("div", { class: "group", role: "group", "aria-label": name }, make("span", { class: "small" }, name), ...parts);
      const bar = make("div", { class: "bar" });
      bar.append(group("Axes", ...this.channels.map((c) => this.toggle(c.axis, this.shown, c.index, `c${c.index % 6}`))));
      if (this.fitted) bar.append(group("Lines", this.toggle("fit", this.lines, "fit", ""), ...this.terms.map((t) => this.toggle(t, this.lines, t, ""))));
      const units = make("select", { "aria-label": `Unit of the ${this.data.name.toLowerCase()}` }, ...this.data.units.map((u, i) => make("option", { value: i }, u.label || "1")));
      units.addEventListener("change", () => { this.unit = this.data.units[units.value]; this.cells(); this.draw(); });
      bar.append(group("Unit", units));
      const what = make("select", { "aria-label": "What to copy" }, ...this.tables().map((name) => make("option", {}, name)));
      const said = make("span", { role: "status", class: "small" });
      const copy = (form) => make("button", { type: "button", onclick: () => this.copy(what.value, form, said) }, form);
      bar.append(group("Copy", what, copy("CSV"), copy("YAML"), copy("JSON"), said));
      return bar;
    }
    // coefficients of the tables of the page, in the unit that is chosen
    cells() {
      const page = this.root.closest("article, main");
      for (const c of this.channels) for (const [term, found] of Object.entries(c.terms || {})) {
        const [scale, label] = this.unit.terms[term];
        for (const cell of page.querySelectorAll(`[data-number="${CSS.escape(`${c.name}.${term}`)}"]`)) {
          const shown = cell.querySelector(".number"), exact = cell.querySelector(".exact");
          if (found.verdict === "not detected") shown.textContent = found.limit === null ? "open" : `< ${number(found.limit / scale, 2)}`;
          else {
            const [value, low, high] = interval(found.value / scale, found.low / scale, found.high / scale);
            shown.textContent = `${value} ± ${number((found.high - found.low) / 2 / scale, 2)}${found.verdict === "hint" ? " hint" : ""}`;
            if (exact) exact.textContent = `${low} to ${high}`;
          }
          cell.parentElement.querySelector("td.small").textContent = label;
        }
      }
    }
    draw() { this.views.forEach((view) => view.draw()); }

    // what may be copied, as rows of named values in the chosen unit
    tables() { return [...(this.fitted ? ["coefficients"] : []), ...Object.keys(VIEWS).filter((name) => this.channels.some(has[name]))]; }
    rows(name) {
      const round = (v) => (v === null || v === undefined || !Number.isFinite(v) ? null : Number(v.toPrecision(6)));
      const chosen = this.channels.filter((c) => this.shown.has(c.index));
      if (name === "coefficients") {
        return chosen.flatMap((c) => Object.entries(c.terms || {}).map(([term, found]) => {
          const [scale, unit] = this.unit.terms[term];
          const part = (key) => round(found[key] === null ? null : found[key] / scale);
          return { channel: c.name, term, value: part("value"), low: part("low"), high: part("high"), upper_limit: part("limit"), verdict: found.verdict, unit };
        }));
      }
      const view = VIEWS[name], scale = view.scale(this), key = { tau: "tau_s", f: "frequency_hz", t: "time_s" }[view.kind];
      const unit = { allan: this.unit.label, spectrum: `(${this.unit.label})²/Hz`, residual: "1", signal: this.unit.label }[name];
      return chosen.filter(has[name]).flatMap((c) => view.at(c, this).map((x, i) => {
        const [low, high] = view.limits(c, i, this), value = view.values(c)[i];
        const row = { channel: c.name, [key]: x, value: round(value === null ? null : value / scale), low: round(low === null ? null : low / scale), high: round(high === null ? null : high / scale), unit };
        if (name === "spectrum" && c.spectrum.fit) row.fitted = round(c.spectrum.fit[i] / scale);
        return row;
      }));
    }
    text(name, form) {
      const rows = this.rows(name);
      if (form === "JSON") return JSON.stringify(rows, null, 1);
      const plain = (v) => (v === null ? (form === "YAML" ? "null" : "") : typeof v === "number" ? String(v) : form === "YAML" ? JSON.stringify(v) : /[",\n]/.test(v) ? `"${v.replace(/"/g, '""')}"` : v);
      if (form === "YAML") return rows.map((row) => `- {${Object.entries(row).map(([k, v]) => `${k}: ${plain(v)}`).join(", ")}}`).join("\n") + "\n";
      return [Object.keys(rows[0] || {}).join(","), ...rows.map((row) => Object.values(row).map(plain).join(","))].join("\n") + "\n";
    }
    async copy(name, form, said) {
      const text = this.text(name, form);
      this.copied = text;
      const old = this.live.querySelector("textarea");
      if (old) old.remove();
      try {
        await navigator.clipboard.writeText(text);
        said.textContent = `${name} copied as ${form}`;
      } catch {  // a browser that lets no page write there: the text to be copied by hand
        const area = make("textarea", { "aria-label": `${name} as ${form}`, readonly: "", rows: "6" });
        area.value = text;
        this.live.querySelector(".bar").append(area);
        area.select();
        said.textContent = "copy the text below";
      }
    }
  }

  class View {
    constructor(explorer, name, where) {
      Object.assign(this, { explorer, name, view: VIEWS[name] });
      const data = explorer.data, view = this.view;
      this.channels = explorer.channels.filter(has[name]);
      this.readout = make("p", { class: "readout small" });
      this.host = make("div", { class: "chart", tabindex: "0", role: "img", "aria-label": `${data.name}: ${view.title(data)}. Arrow keys read values, + and - zoom, 0 shows all.` });
      const act = (label, text, run) => make("button", { type: "button", "aria-label": `${label}, ${view.title(data)}`, title: label, onclick: run }, text);
      const zoom = make("span", { class: "zoom" }, act("Zoom in", "+", () => this.zoomBy(0.5)), act("Zoom out", "−", () => this.zoomBy(2)), act("Show all", "↔", () => this.zoom(null)));
      const said = view.about(data) + (explorer.fitted && (name === "allan" || name === "spectrum") ? " Line: fitted model; dashed: its terms, dotted at an upper limit." : "");
      where.append(make("figure", {}, make("div", { class: "title" }, make("b", {}, view.title(data)), zoom), this.host, this.readout, make("figcaption", {}, said)));
      this.make();
      this.host.addEventListener("keydown", (event) => this.key(event));
      this.pinch();
      new ResizeObserver(() => { if (this.host.clientWidth && this.plot.width !== this.host.clientWidth) this.plot.setSize(this.size()); }).observe(this.host);
    }
    size() { return { width: this.host.clientWidth || 320, height: Math.round(Math.min(Math.max((this.host.clientWidth || 320) * 0.58, 250), 380)) }; }
    scaled() {
      const { explorer, view } = this, scale = view.scale(explorer);
      const by = (values) => values.map((v) => (v === null || (view.logY && !(v > 0)) ? null : v / scale));
      const tables = this.channels.map((c) => {
        const table = [view.at(c, explorer), by(view.values(c))];
        if (this.name === "signal") table.push(by(c.signal.real.low), by(c.signal.real.high));
        return table;
      });
      return uPlot.join(tables);
    }
    make() {
      if (this.plot) this.plot.destroy();
      const { explorer, view } = this, ink = color("ink"), grid = color("grid"), muted = color("muted"), font = "12px system-ui, sans-serif";
      const axis = (label, log) => ({ label, ...(log ? { splits: decades, filter: (u, splits) => splits } : {}), stroke: ink, font, labelFont: font, labelSize: 18, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1, size: 4 }, values: (u, splits) => splits.map((v) => (v === null ? "" : tick(v))) });
      const per = this.name === "signal" ? 3 : 1;
      const series = this.channels.flatMap((c) => Array.from({ length: per }, (_, k) => ({ show: explorer.shown.has(c.index), stroke: explorer.color(c), paths: () => null, points: { show: false }, label: c.axis, part: k })));
      this.full = this.range();
      this.plot = new uPlot({
        ...this.size(), padding: [10, 20, 0, 0], legend: { show: false },
        scales: {
          x: { time: false, distr: view.logX ? 3 : 1, range: (u, low, high) => [low, high] },
          y: { distr: view.logY ? 3 : 1, range: (u, low, high) => this.rangeY(low, high) },
        },
        axes: [{ ...axis(view.x(), view.logX), space: 45, size: 34 }, { ...axis(view.y(explorer), view.logY), size: 62, space: 28 }],
        series: [{}, ...series],
        cursor: { drag: { x: true, y: false, uni: 8 }, points: { show: (u, i) => (series[i - 1].part === 0 ? undefined : false), size: 8, fill: (u, i) => series[i - 1].stroke } },
        hooks: {
          drawClear: [(u) => this.under(u)], draw: [(u) => this.over(u)], setCursor: [(u) => this.moved(u)],
          setSelect: [(u) => { if (u.select.width > 5) this.zoom([u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")]); }],
        },
      }, this.scaled(), this.host);
      this.plot.over.addEventListener("dblclick", () => this.zoom(null));
      this.other = make("div", { class: "elsewhere", hidden: "" });
      this.plot.over.append(this.other);
      const [low, high] = zooms[view.kind] || this.full;
      this.plot.setScale("x", { min: low, max: high });
      this.say(null);
    }
    range() {
      const xs = this.channels.flatMap((c) => this.view.at(c, this.explorer));
      let low = Math.min(...xs), high = Math.max(...xs);
      if (this.view.logX) [low, high] = [low / 1.15, high * 1.15];
      else [low, high] = [0, Math.max(this.explorer.data.duration, high)];
      return [low, high];
    }
    rangeY(low, high) {
      if (low === null || high === null || !Number.isFinite(low + high)) return this.view.logY ? [0.1, 10] : [-1, 1];
      if (this.name === "residual") return [Math.min(low / 1.2, 0.4), Math.max(high * 1.2, 2.5)];
      if (this.view.logY) return [low / 1.7, high * 1.7];
      const room = (high - low || Math.abs(high) || 1) * 0.06;
      return [low - room, high + room];
    }
    draw() {
      const u = this.plot;
      u.axes[1].label = this.view.y(this.explorer);
      u.batch(() => {
        u.series.slice(1).forEach((s, i) => u.setSeries(i + 1, { show: this.explorer.shown.has(this.channels[Math.floor(i / (this.name === "signal" ? 3 : 1))].index) }));
        u.setData(this.scaled(), false);
        const [low, high] = zooms[this.view.kind] || this.full;
        u.setScale("x", { min: low, max: high });
      });
      this.say(null);
    }
    // zoom all views of the same abscissa
    zoom(range) {
      const [low, high] = this.full;
      if (range) {
        range = [Math.max(range[0], low), Math.min(range[1], high)];
        const small = this.view.logX ? range[1] / range[0] < 1.05 : range[1] - range[0] < (high - low) / 200;
        if (small) return;
        if (range[0] <= low && range[1] >= high) range = null;
      }
      if (range) zooms[this.view.kind] = range; else delete zooms[this.view.kind];
      for (const one of explorers.flatMap((e) => e.views)) {
        if (one.view.kind !== this.view.kind) continue;
        const [a, b] = range || one.full;
        one.plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        one.plot.setScale("x", { min: a, max: b });
      }
    }
    zoomBy(factor, at) {
      const { min, max } = this.plot.scales.x, log = this.view.logX;
      const [a, b] = log ? [Math.log(min), Math.log(max)] : [min, max], left = this.plot.cursor.left;
      let middle = at !== undefined ? at : left >= 0 ? this.plot.posToVal(left, "x") : null;
      middle = middle === null ? (a + b) / 2 : log ? Math.log(middle) : middle;
      const ends = [middle - (middle - a) * factor, middle + (b - middle) * factor];
      this.zoom(log ? ends.map(Math.exp) : ends);
    }
    pinch() {
      const touches = new Map();
      let before = null;
      const spread = () => { const [a, b] = [...touches.values()]; return [Math.max(Math.abs(a - b), 10), (a + b) / 2]; };
      this.host.addEventListener("pointerdown", (e) => { if (e.pointerType === "touch") { touches.set(e.pointerId, e.offsetX); before = null; } });
      this.host.addEventListener("pointermove", (e) => {
        if (!touches.has(e.pointerId)) return;
        touches.set(e.pointerId, e.offsetX);
        if (touches.size !== 2) return;
        const [wide, middle] = spread();
        if (before) this.zoomBy(before / wide, this.plot.posToVal(middle - this.plot.bbox.left / devicePixelRatio, "x"));
        before = wide;
      });
      for (const end of ["pointerup", "pointercancel", "pointerleave"]) this.host.addEventListener(end, (e) => { touches.delete(e.pointerId); before = null; });
    }
    key(event) {
      const u = this.plot, steps = { ArrowLeft: -1, ArrowRight: 1 };
      if (event.key in steps) {
        const xs = u.data[0].filter((x) => x >= u.scales.x.min && x <= u.scales.x.max);
        if (!xs.length) return;
        const i = u.cursor.left >= 0 ? nearest(xs, u.posToVal(u.cursor.left, "x"), this.view.logX) + steps[event.key] : 0;
        u.setCursor({ left: u.valToPos(xs[Math.min(Math.max(i, 0), xs.length - 1)], "x"), top: 10 });
      } else if (event.key === "+") this.zoomBy(0.5);
      else if (event.key === "-") this.zoomBy(2);
      else if (event.key === "0") this.zoom(null);
      else return;
      event.preventDefault();
    }
    // the values under the pointer, and the same place in the views beside
    moved(u) {
      const inside = u.cursor.left >= 0 && u.cursor.top >= 0;
      const x = inside ? u.posToVal(u.cursor.left, "x") : null;
      if (this.following) return;
      this.say(x);
      const kind = this.view.kind, twin = { tau: ["f", 0.5 / x], f: ["tau", 0.5 / x] }[kind];
      for (const one of explorers.flatMap((e) => e.views)) {
        if (one === this) continue;
        const at = x === null ? null : one.view.kind === kind ? x : twin && one.view.kind === twin[0] ? twin[1] : null;
        one.mark(at);
      }
    }
    mark(x) {
      const { min, max } = this.plot.scales.x, there = x !== null && x >= min && x <= max;
      this.other.hidden = !there;
      if (there) this.other.style.left = `${this.plot.valToPos(x, "x")}px`;
      this.say(there ? x : null);
    }
    say(x) {
      const { explorer, view } = this;
      if (x === null) { this.readout.textContent = "Move over the chart, or tap it, to read values; drag to zoom."; return; }
      const scale = view.scale(explorer), unit = this.name === "residual" ? "" : this.name === "spectrum" ? ` ${view.y(explorer).slice(9, -1)}` : ` ${explorer.unit.label}`;
      const parts = [];
      let shownAt = x;
      for (const c of this.channels) {
        if (!explorer.shown.has(c.index)) continue;
        const xs = view.at(c, explorer), i = nearest(xs, x, view.logX), value = view.values(c)[i];
        shownAt = xs[i];
        if (value === null) { parts.push([c, "missing"]); continue; }
        const [low, high] = view.limits(c, i, explorer);
        const [v, a, b] = low === null ? [number(value / scale)] : this.name === "signal" || this.name === "residual" ? [value, low, high].map((one) => number(one / scale)) : interval(value / scale, low / scale, high / scale);
        const words = this.name === "residual" ? `${v} (expected ${a} to ${b})` : a === undefined ? v : `${v} (${a} to ${b})`;
        const event = this.name === "signal" ? (c.events || []).filter(([start, stop]) => x >= start - c.signal.length && x <= stop + c.signal.length).map((one) => one[2]).join(", ") : "";
        parts.push([c, words + unit + (event && `, ${event}`)]);
      }
      this.readout.replaceChildren(make("span", {}, view.name(shownAt)), ...parts.flatMap(([c, words]) => [" ", make("span", { class: `c${c.index % 6}` }, make("b", {}, c.axis), ` ${words}`)]));
    }

    // drawing: below the grid's data and above it
    clipped(u, run) {
      const { left, top, width, height } = u.bbox;
      u.ctx.save();
      u.ctx.beginPath();
      u.ctx.rect(left, top, width, height);
      u.ctx.clip();
      run(u.ctx);
      u.ctx.restore();
    }
    line(u, ctx, xs, ys, scale) {
      ctx.beginPath();
      let pen = false;
      xs.forEach((x, i) => {
        const y = ys[i];
        if (y === null || (this.view.logY && !(y > 0))) { pen = false; return; }
        const a = u.valToPos(x, "x", true), b = u.valToPos(y / scale, "y", true);
        if (pen) ctx.lineTo(a, b); else ctx.moveTo(a, b);
        pen = true;
      });
      ctx.stroke();
    }
    band(u, ctx, xs, low, high, scale) {
      const top = [], bottom = [];
      const flush = () => {
        if (top.length) {
          ctx.beginPath();
          [...top, ...bottom.reverse()].forEach(([a, b], i) => (i ? ctx.lineTo(a, b) : ctx.moveTo(a, b)));
          ctx.fill();
        }
        top.length = bottom.length = 0;
      };
      xs.forEach((x, i) => {
        if (low[i] === null || high[i] === null) { flush(); return; }
        const a = u.valToPos(x, "x", true), floor = this.view.logY ? u.scales.y.min / 10 : -Infinity;
        top.push([a, u.valToPos(high[i] / scale, "y", true)]);
        bottom.push([a, u.valToPos(Math.max(low[i] / scale, floor), "y", true)]);
      });
      flush();
    }
    under(u) {
      const { explorer, view, name } = this, scale = view.scale(explorer);
      this.clipped(u, (ctx) => {
        const shown = this.channels.filter((c) => explorer.shown.has(c.index));
        if (name === "residual" && shown.length) {
          ctx.fillStyle = color("shade");
          const c = shown[0];
          this.band(u, ctx, view.at(c, explorer), explorer.grid(c.spectrum.lower), explorer.grid(c.spectrum.upper), 1);
        }
        if (name === "allan" || name === "signal") for (const c of shown) {
          ctx.fillStyle = explorer.color(c);
          ctx.globalAlpha = name === "allan" ? 0.16 : 0.3;
          const part = name === "allan" ? c.allan : c.signal.real;
          this.band(u, ctx, view.at(c, explorer), part.low, part.high, scale);
        }
      });
    }
    over(u) {
      const { explorer, view, name } = this, scale = view.scale(explorer), ratio = uPlot.pxRatio || devicePixelRatio;
      this.placed = [];
      this.clipped(u, (ctx) => {
        const shown = this.channels.filter((c) => explorer.shown.has(c.index)), alone = shown.length === 1;
        ctx.lineJoin = "round";
        if (name === "residual") { ctx.strokeStyle = color("ink"); ctx.lineWidth = ratio; this.line(u, ctx, this.full, [1, 1], 1); }
        for (const c of shown) {
          ctx.strokeStyle = ctx.fillStyle = explorer.color(c);
          const xs = view.at(c, explorer), values = view.values(c), used = c.allan && name === "allan" && c.allan.used !== undefined ? explorer.grid(c.allan.used) : null;
          ctx.globalAlpha = 1;
          if (name === "allan") this.dots(u, ctx, xs, values, scale, used, ratio);
          else {
            const thin = name !== "signal" && explorer.fitted;
            ctx.lineWidth = (thin ? 1 : 1.5) * ratio;
            ctx.globalAlpha = name === "spectrum" && thin ? 0.6 : 1;
            this.line(u, ctx, xs, values, scale);
          }
          ctx.globalAlpha = 1;
          if (name === "allan" || name === "spectrum") this.model(u, ctx, c, scale, alone, c === shown[0], ratio);
          if (name === "signal") this.events(u, ctx, c, ratio);
        }
      });
    }
    dots(u, ctx, xs, values, scale, used, ratio) {
      xs.forEach((x, i) => {
        if (!(values[i] > 0)) return;
        ctx.beginPath();
        ctx.arc(u.valToPos(x, "x", true), u.valToPos(values[i] / scale, "y", true), 2.6 * ratio, 0, 2 * Math.PI);
        if (!used || used[i]) ctx.fill(); else { ctx.lineWidth = ratio; ctx.stroke(); }
      });
    }
    model(u, ctx, c, scale, alone, first, ratio) {
      const { explorer, name } = this, part = c[name], model = part.model;
      if (!model) return;
      const total = name === "allan" ? [explorer.grid(model.x), model.total] : [explorer.grid(part.f), part.fit];
      if (explorer.lines.has("fit")) { ctx.lineWidth = 2 * ratio; this.line(u, ctx, ...total, scale); }
      const xs = explorer.grid(model.x);
      for (const [term, [detected, values]] of Object.entries(model.terms)) {
        if (!explorer.lines.has(term)) continue;
        ctx.setLineDash((detected ? [7, 4] : [1.5, 4]).map((v) => v * ratio));
        ctx.lineWidth = 1.2 * ratio;
        ctx.globalAlpha = alone ? 1 : 0.5;
        this.line(u, ctx, xs, values, scale);
        ctx.globalAlpha = 1;
        ctx.setLineDash([]);
        if (first || alone) this.letter(u, ctx, c, term, detected, xs, values, total, scale, alone, ratio);
      }
    }
    // the name of a term, where it is nearest to the curve
    letter(u, ctx, c, term, detected, xs, values, total, scale, alone, ratio) {
      const { min, max } = u.scales.x, { min: low, max: high } = u.scales.y;
      let best = -1, most = -Infinity;
      xs.forEach((x, i) => {
        const y = values[i] / scale, inner = this.view.logX ? x > min * 1.3 && x < max / 1.3 : true;
        if (!inner || !(y > low && y < high)) return;
        const share = values[i] / total[1][nearest(total[0], x, true)];
        if (share > most * 1.0001) [best, most] = [i, share];
      });
      if (best < 0) return;
      const [size, unit] = explorer_unit(this.explorer, term), found = c.terms[term] || {};
      const words = alone ? (detected ? `${term} = ${interval(found.value / size, found.low / size, found.high / size)[0]} ${unit}` : `${term} < ${number(found.limit / size, 2)} ${unit}`) : term;
      ctx.font = `bold ${12 * ratio}px system-ui, sans-serif`;
      ctx.textBaseline = "bottom";
      ctx.textAlign = "left";
      const a = u.valToPos(xs[best], "x", true), b = u.valToPos(values[best] / scale, "y", true), wide = ctx.measureText(words).width;
      const left = Math.min(Math.max(a - wide / 2, u.bbox.left + 4 * ratio), u.bbox.left + u.bbox.width - wide - 4 * ratio);
      let base = Math.min(Math.max(b - 8 * ratio, u.bbox.top + 16 * ratio), u.bbox.top + u.bbox.height - 4 * ratio);
      const room = 14 * ratio, meets = ([l, w, y]) => l < left + wide && left < l + w && Math.abs(y - base) < room;
      for (let k = 0; k < 8 && this.placed.some(meets); k++) base = Math.min(...this.placed.filter(meets).map((one) => one[2])) - room;
      this.placed.push([left, wide, base]);
      ctx.save();
      ctx.lineWidth = 3 * ratio;
      ctx.strokeStyle = color("paper");
      ctx.strokeText(words, left, base);
      ctx.fillText(words, left, base);
      ctx.restore();
      ctx.beginPath();
      ctx.arc(a, b, 3.5 * ratio, 0, 2 * Math.PI);
      ctx.lineWidth = 1.5 * ratio;
      ctx.stroke();
    }
    events(u, ctx, c, ratio) {
      (c.events || []).forEach(([start, stop, words], k) => {
        const { left, top, height } = u.bbox, a = u.valToPos(start, "x", true), b = u.valToPos(stop, "x", true);
        if (b > a) { ctx.globalAlpha = 0.08; ctx.fillRect(a, top, b - a, height); ctx.globalAlpha = 1; }
        ctx.setLineDash([4 * ratio, 3 * ratio]);
        ctx.lineWidth = 1.3 * ratio;
        ctx.beginPath();
        ctx.moveTo(a, top);
        ctx.lineTo(a, top + height);
        ctx.stroke();
        ctx.setLineDash([]);
        ctx.font = `${12 * ratio}px system-ui, sans-serif`;
        ctx.textBaseline = "top";
        ctx.textAlign = "left";
        const text = `${c.axis}: ${words}`, wide = ctx.measureText(text).width;
        ctx.fillText(text, Math.min(Math.max(a + 4 * ratio, left), left + u.bbox.width - wide - 4 * ratio), top + (4 + 15 * (k + 2 * c.index)) * ratio);
      });
    }
  }
  const explorer_unit = (explorer, term) => explorer.unit.terms[term] || [1, ""];

  for (const root of document.querySelectorAll(".explore")) explorers.push(new Explorer(root));
  dark.addEventListener("change", () => explorers.forEach((e) => e.views.forEach((view) => view.make())));
})();
