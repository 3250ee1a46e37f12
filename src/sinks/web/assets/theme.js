// Colours before the first paint: a classic script in the head, so that nothing flashes.
"use strict";
(() => {
  const KEY = "gaware-theme";
  const names = { auto: "Auto", light: "Light", dark: "Dark" };
  const spoken = { auto: "as the system", light: "light", dark: "dark" };
  const read = () => {
    try {
      return localStorage.getItem(KEY) in names ? localStorage.getItem(KEY) : "auto";
    } catch {
      return "auto"; // Private windows may refuse storage.
    }
  };
  const apply = (theme) => {
    if (theme === "auto") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
    const button = document.getElementById("theme");
    if (button) {
      button.textContent = names[theme];
      button.setAttribute("aria-label", `Colours: ${spoken[theme]}`);
    }
    window.dispatchEvent(new Event("themechange"));
  };
  let theme = read();
  apply(theme);
  document.addEventListener("DOMContentLoaded", () => {
    apply(theme);
    document.getElementById("theme").addEventListener("click", () => {
      const order = Object.keys(names);
      theme = order[(order.indexOf(theme) + 1) % order.length];
      try {
        localStorage.setItem(KEY, theme);
      } catch {
        // The choice then lasts as long as the page.
      }
      apply(theme);
    });
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => apply(theme));
})();
