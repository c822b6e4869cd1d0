// The log that is chosen, or under the pointer, stands out in every figure; its result is one click away.
(() => {
  "use strict";
  const curves = [...document.querySelectorAll("[data-log]")], choice = document.getElementById("log"), result = document.getElementById("result");
  const show = (name) => {
    choice.value = name;
    const own = curves.filter((curve) => curve.dataset.log === name);
    for (const curve of curves) curve.classList.toggle("chosen", own.includes(curve));
    for (const curve of own) curve.parentNode.append(curve); // on top of the others
    result.hidden = !own.length || !own[0].hasAttribute("href");
    if (!result.hidden) result.setAttribute("href", own[0].getAttribute("href"));
  };
  for (const curve of curves) curve.addEventListener("pointerenter", () => { if (!curve.classList.contains("chosen")) show(curve.dataset.log); });
  choice.addEventListener("change", () => show(choice.value));
})();
