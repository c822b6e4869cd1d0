// What is wrong with the page as it is shown now, as sentences; none if nothing is.
(() => {
  const wrong = [], html = document.documentElement, print = matchMedia("print").matches;
  const say = (element, what) => wrong.push(`${element.tagName.toLowerCase()} "${(element.textContent || "").trim().slice(0, 40)}" ${what}`);
  const seen = (element) => element.checkVisibility();
  const room = html.clientWidth;
  if (html.scrollWidth > room + 1) wrong.push(`the page is ${html.scrollWidth} wide in ${room}`);

  const elements = [...document.body.querySelectorAll("*")].filter((e) => !e.closest("svg") && seen(e));
  for (const e of elements) {
    const box = e.getBoundingClientRect(), scrolls = e.closest(".scroll, pre");
    if (!scrolls && (box.right > room + 1 || box.left < -1)) say(e, `reaches from ${box.left} to ${box.right} of ${room}`);
    if (scrolls === e && print && e.scrollWidth > e.clientWidth + 1) say(e, "is cut on paper");
    if (/^(TD|TH|SPAN|SUMMARY|LI|DD|DT|P|H[1-6])$/.test(e.tagName) && e.clientWidth && e.scrollWidth > e.clientWidth + 1) say(e, "holds wider text");
    if (/^(P|LI|DD|DT|H[1-6]|CAPTION|FIGCAPTION|SUMMARY|TABLE|UL)$/.test(e.tagName) && !e.textContent.trim()) say(e, "is empty");
    if (box.width === 0 || box.height === 0) if (e.textContent.trim()) say(e, "has no size");
  }

  // contrast of letters on what lies behind them
  const parse = (color) => {
    const found = color.match(/[\d.]+/g).map(Number);
    return [found[0], found[1], found[2], found.length > 3 ? found[3] : 1];
  };
  const over = (top, below) => [0, 1, 2].map((i) => top[i] * top[3] + below[i] * (1 - top[3])).concat(1);
  const behind = (element) => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) layers.push(parse(getComputedStyle(e).backgroundColor));
    return layers.reverse().reduce((below, top) => over(top, below), [255, 255, 255, 1]);
  };
  const light = (c) => {
    const [r, g, b] = c.slice(0, 3).map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const contrast = (a, b) => (Math.max(light(a), light(b)) + 0.05) / (Math.min(light(a), light(b)) + 0.05);
  for (const e of elements) {
    if (![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())) continue;
    const back = behind(e), found = contrast(over(parse(getComputedStyle(e).color), back), back);
    if (found < 4.5) say(e, `has a contrast of ${found.toFixed(2)}`);
  }

  // letters of figures are text, or paths in groups named text_N
  let letters = 0;
  for (const svg of document.querySelectorAll("svg")) {
    if (!seen(svg)) continue;
    const frame = svg.getBoundingClientRect(), back = behind(svg.parentElement), name = svg.getAttribute("aria-labelledby");
    const drawn = [...svg.querySelectorAll("g")].filter((g) => /text_\d+$/.test(g.id) && !g.querySelector("g[id*=text_]"));
    const texts = [...drawn, ...svg.querySelectorAll("text")];
    const boxes = texts.map((g) => g.getBoundingClientRect());
    texts.forEach((g, i) => {
      const box = boxes[i];
      if (!box.width && !box.height) return;
      letters += 1;
      if (box.left < frame.left - 1 || box.right > frame.right + 1 || box.top < frame.top - 1 || box.bottom > frame.bottom + 1)
        wrong.push(`${name}: ${g.id || g.textContent} is cut`);
      for (let k = 0; k < i; k++) {
        const other = boxes[k];
        const across = Math.min(box.right, other.right) - Math.max(box.left, other.left);
        const up = Math.min(box.bottom, other.bottom) - Math.max(box.top, other.top);
        if (across > 1 && up > 1) wrong.push(`${name}: ${g.id || g.textContent} lies on ${texts[k].id || texts[k].textContent}`);
      }
      const style = getComputedStyle(g.querySelector("use, path") || g);
      const fill = parse(style.fill), found = contrast(over(fill, back), back);
      if (found < 4.5) wrong.push(`${name}: ${g.id || g.textContent} has a contrast of ${found.toFixed(2)}`);
    });
  }
  const bad = document.body.innerText.match(/\b(NaN|nan|undefined|null|None|Infinity|inf)\b(?!\.)|\[object/);
  if (bad) wrong.push(`the text holds ${bad[0]}`);
  return {wrong, letters, paper: behind(document.body)};
})()
