// The log that is chosen, or under the pointer, stands out in every figure; its page, or else its result, is one click away.
(() => {
  "use strict";
  const curves = [...document.querySelectorAll("[data-log]")], choice = document.getElementById("log"), result = document.getElementById("result");
  const show = (name) => {
    choice.value = name;
    const own = curves.filter((curve) => curve.dataset.log === name);
    for (const curve of curves) curve.classList.toggle("chosen", own.includes(curve));
    for (const curve of own) curve.parentNode.append(curve); // on top of the others
    const page = choice.selectedOptions[0].dataset.page;
    result.hidden = !page;
    result.setAttribute("href", page || "");
    result.textContent = (page || "").endsWith(".html") ? "its page" : "its result";
  };
  for (const curve of curves) curve.addEventListener("pointerenter", () => { if (!curve.classList.contains("chosen")) show(curve.dataset.log); });
  choice.addEventListener("change", () => show(choice.value));
})();
