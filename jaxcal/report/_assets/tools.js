// What the scripts of a page have in common: elements, numbers as the tables have them, and paper.
const jaxcal = (() => {
  "use strict";
  const html = document.documentElement, dark = matchMedia("(prefers-color-scheme: dark)");
  const color = (name) => getComputedStyle(html).getPropertyValue(`--${name}`).trim();
  const make = (tag, attributes = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else element.setAttribute(name, value);
    }
    element.append(...children);
    return element;
  };

  // numbers as the tables have them
  const power = (value) => Math.floor(Math.log10(Math.abs(value)));
  const raised = (exponent) => String(exponent).replace(/[-0-9]/g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
  const number = (value, digits = 3) => {
    if (value === null || !Number.isFinite(value)) return value === Infinity || value === null ? "∞" : "–";
    if (value === 0) return "0";
    const [mantissa, exponent] = value.toExponential(Math.max(digits, 1) - 1).split("e");
    if (exponent > -4 && exponent < 5) return Number(`${mantissa}e${exponent}`).toFixed(Math.max(digits - 1 - exponent, 0));
    return `${mantissa}×10${raised(Number(exponent))}`;
  };
  const interval = (value, low, high) => {
    const half = (high - low) / 2;
    let digits = 3;
    if (value > 0 && half > 0 && half < Infinity) digits = Math.min(Math.max(power(value) - power(half) + 1, 2), 4);
    const like = (end) => (value > 0 && end > 0 && end < Infinity ? number(end, digits + power(end) - power(value)) : number(end));
    return [number(value, digits), like(low), like(high)];
  };
  const tick = (value) => number(value, 3).replace(/(\.\d*?)0+(?=×|$)/, "$1").replace(/\.(?=×|$)/, "").replace(/^1×10/, "10");

  // powers of ten, with 2 and 5 between where there is room; all digits within a decade
  const decades = (u, axis, low, high) => {
    const span = Math.log10(high / low), parts = span < 0.9 ? [1, 2, 3, 4, 5, 6, 7, 8, 9] : span < 3.3 ? [1, 2, 5] : [1];
    const every = Math.max(Math.round(span / 7), 1), found = [];
    for (let p = Math.floor(Math.log10(low)); p <= Math.log10(high); p += every) for (const part of parts) found.push(part * 10 ** p);
    return found.filter((value) => value >= low * 0.999 && value <= high * 1.001);
  };

  const nearest = (xs, x, log) => {
    let best = -1, least = Infinity;
    xs.forEach((value, i) => {
      const apart = Math.abs(log ? Math.log(value / x) : value - x);
      if (apart < least) [best, least] = [i, apart];
    });
    return best;
  };

  let closed = [];
  addEventListener("beforeprint", () => {
    closed = [...document.querySelectorAll("details:not([open])")];
    closed.forEach((one) => { one.open = true; });
  });
  addEventListener("afterprint", () => closed.forEach((one) => { one.open = false; }));
  return { dark, color, make, number, interval, tick, decades, nearest };
})();
