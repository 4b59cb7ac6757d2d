// Lets node import the page's TypeScript: `node --import ./tests/typescript.mjs`.

import { register } from "node:module";

register("./typescript-hooks.mjs", import.meta.url);
