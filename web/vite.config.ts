import { readFileSync } from "node:fs";
import path from "node:path";
import { defineConfig, type Plugin } from "vite";

/** Shaders of the page's materials: Phong, basic, lines, and the shadow map. */
const SHADERS = ["meshphong", "meshbasic", "depth", "vsm"];
/** Parts that three.js puts before every shader, and that of the outlines. */
const ALWAYS = ["tonemapping_pars_fragment", "colorspace_pars_fragment", "colorspace_fragment"];

/**
 * Leaves out what the page never uses of three.js: headsets, reflections of the surroundings, the table and the shaders
 * of other materials, and comments and indentation of shaders.
 */
function lighterThree(): Plugin {
  let used: Set<string> | null = null;
  return {
    name: "lighter-three",
    load(id) {
      if (id.endsWith("/extras/PMREMGenerator.js")) return NO_REFLECTIONS;
      if (id.endsWith("/shaders/DFGLUTData.js")) return NO_SPECULAR_TABLE;
      return id.endsWith("/webxr/WebXRManager.js") ? NO_HEADSETS : null;
    },
    transform(code, id) {
      if (!id.endsWith(".glsl.js")) return null;
      const name = path.basename(id, ".glsl.js");
      used ??= usedParts(path.dirname(path.dirname(id)));
      const isUsed = id.includes("/ShaderLib/") ? SHADERS.includes(name) : used.has(name);
      if (!isUsed) return { code: code.replace(/`[\s\S]*?`/g, "``"), map: null };
      const text = code.replace(/\/\*[\s\S]*?\*\//g, "").replace(/\/\/.*$/gm, "").replace(/^\s+/gm, "");
      return { code: text, map: null };
    },
  };
}

/** Names of the parts that the used shaders include. */
function usedParts(folder: string): Set<string> {
  const parts = new Set<string>();
  const include = (text: string) => {
    for (const [, name] of text.matchAll(/#include <(\w+)>/g)) add(name!);
  };
  const add = (name: string) => {
    if (parts.has(name)) return;
    parts.add(name);
    include(readFileSync(path.join(folder, "ShaderChunk", `${name}.glsl.js`), "utf8"));
  };
  for (const name of SHADERS) include(readFileSync(path.join(folder, "ShaderLib", `${name}.glsl.js`), "utf8"));
  ALWAYS.forEach(add);
  return parts;
}

const NO_REFLECTIONS = `
export class PMREMGenerator {
  dispose() {}
}`;

const NO_SPECULAR_TABLE = `
export function getDFGLUT() { return null; }`;

const NO_HEADSETS = `
import { EventDispatcher } from "three/src/core/EventDispatcher.js";
export class WebXRManager extends EventDispatcher {
  enabled = false;
  isPresenting = false;
  setAnimationLoop() {}
  hasDepthSensing() { return false; }
  getEnvironmentBlendMode() { return undefined; }
  dispose() {}
}`;

// Fixed file names and no source maps: the same sources and lock file give the same bytes, which are committed.
export default defineConfig({
  base: "./",
  plugins: [lighterThree()],
  resolve: {
    // The sources of three.js, so that its parts can be left out.
    alias: [{ find: /^three$/, replacement: "three/src/Three.js" }],
  },
  build: {
    target: "es2022",
    outDir: "dist",
    emptyOutDir: true,
    modulePreload: false,
    cssCodeSplit: false,
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 700,
    reportCompressedSize: false,
    rollupOptions: {
      output: {
        entryFileNames: "assets/app.js",
        chunkFileNames: "assets/[name].js",
        assetFileNames: "assets/style[extname]",
      },
    },
  },
});
