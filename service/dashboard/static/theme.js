// Loaded before the page is painted: otherwise a chosen theme would flash.
"use strict";
(() => {
  const KEY = "polhode.theme";
  const CHOICES = ["auto", "light", "dark"];
  const chosen = () => {
    try { return CHOICES.includes(localStorage.getItem(KEY)) ? localStorage.getItem(KEY) : "auto"; }
    catch { return "auto"; } // storage may be forbidden
  };
  const apply = (choice) => {
    if (choice === "auto") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = choice;
    const word = document.querySelector("#theme-button span");
    if (word) word.textContent = choice;
    document.dispatchEvent(new Event("themechange"));
  };
  apply(chosen());
  document.addEventListener("DOMContentLoaded", () => {
    apply(chosen());
    document.getElementById("theme-button").addEventListener("click", () => {
      const next = CHOICES[(CHOICES.indexOf(chosen()) + 1) % CHOICES.length];
      try { localStorage.setItem(KEY, next); } catch { /* then for this page only */ }
      apply(next);
    });
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => apply(chosen()));
})();
