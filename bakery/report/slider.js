"use strict";
// Two pictures of the page over each other, with an edge between them that a range input, or a pointer, moves.
// #left=NAME&right=NAME&at=PERCENT in the address chooses what is shown first.
(() => {
  const box = document.getElementById("slider");
  const [left, right] = box.querySelectorAll("select");
  const [under, over] = box.querySelectorAll(".view img");
  const [leftName, rightName] = box.querySelectorAll(".name");
  const view = box.querySelector(".view"), move = box.querySelector(".move");

  function choose(select, image, label) {
    const name = select.selectedOptions[0].text;
    image.src = document.getElementById(select.value).src;
    image.alt = label.textContent = name;
  }

  function show() {
    choose(left, over, leftName);
    choose(right, under, rightName);
    view.style.setProperty("--at", `${move.value}%`);
    move.setAttribute("aria-valuetext", `${leftName.textContent} ${move.value} %, ${rightName.textContent} the rest`);
  }

  function fromAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    for (const [select, key] of [[left, "left"], [right, "right"]]) {
      const option = [...select.options].find((one) => one.text === asked.get(key));
      if (option) select.value = option.value;
    }
    const at = parseFloat(asked.get("at"));
    if (at >= 0 && at <= 100) move.value = at;
    show();
  }

  function drag(event) {
    const { left: begin, width } = view.getBoundingClientRect();
    move.value = (100 * (event.clientX - begin)) / width;
    show();
  }

  view.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    view.setPointerCapture(event.pointerId);
    drag(event);
  });
  view.addEventListener("pointermove", (event) => {
    if (view.hasPointerCapture(event.pointerId)) drag(event);
  });
  for (const one of [left, right, move]) one.addEventListener("input", show);
  window.addEventListener("hashchange", fromAddress);
  box.hidden = false;
  fromAddress();
})();
