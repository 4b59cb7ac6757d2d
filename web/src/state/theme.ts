// Light or dark: the system's choice until a person makes one.

import { effect, signal } from "@preact/signals";

export type Theme = "light" | "dark";

const KEY = "genmanip.studio.theme";
const system = window.matchMedia("(prefers-color-scheme: dark)");

function stored(): Theme | null {
  try {
    const value = localStorage.getItem(KEY);
    return value === "light" || value === "dark" ? value : null;
  } catch {
    return null;
  }
}

export const theme = signal<Theme>(stored() ?? (system.matches ? "dark" : "light"));
document.documentElement.dataset["theme"] = theme.peek();

system.addEventListener("change", () => {
  if (!stored()) setTheme(system.matches ? "dark" : "light");
});

effect(() => {
  document.documentElement.dataset["theme"] = theme.value;
});

function setTheme(value: Theme): void {
  // The colours are in place before those who draw with them hear of it.
  document.documentElement.dataset["theme"] = value;
  theme.value = value;
}

export function toggleTheme(): void {
  setTheme(theme.peek() === "dark" ? "light" : "dark");
  try {
    localStorage.setItem(KEY, theme.peek());
  } catch {
    // Kept until the page closes.
  }
}
