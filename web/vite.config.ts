import { defineConfig, type Plugin } from "vite";

/** Leaves out what the page never uses of three.js: headsets, and comments and indentation of shaders. */
function lighterThree(): Plugin {
  return {
    name: "lighter-three",
    load(id) {
      return id.endsWith("/webxr/WebXRManager.js") ? NO_HEADSETS : null;
    },
    transform(code, id) {
      if (!id.endsWith(".glsl.js")) return null;
      const text = code.replace(/\/\*[\s\S]*?\*\//g, "").replace(/\/\/.*$/gm, "").replace(/^\s+/gm, "");
      return { code: text, map: null };
    },
  };
}

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
