// The program `genmanip studio`, as a test starts, measures and kills it.

import { spawn } from "node:child_process";
import { readFileSync } from "node:fs";

const START_MS = 60_000;

/** Starts a studio of `paths` and waits for its address; `fileKib`, a limit on the size of the files that it writes, is
 * as a full disk. */
export async function startStudio(program, folder, paths, { port = 0, fileKib = null, options = [] } = {}) {
  const all = [program, "studio", ...paths, "--no-open", "--port", String(port), "--author", "ada", ...options];
  const limited = ["-c", `trap '' XFSZ; ulimit -f ${fileKib}; exec "$@"`, "bash", ...all];
  const [file, given] = fileKib === null ? [program, all.slice(1)] : ["/bin/bash", limited];
  const child = spawn(file, given, { cwd: folder, stdio: ["ignore", "ignore", "pipe"] });
  const ended = new Promise((resolve) => child.on("exit", resolve));
  let said = "";
  const url = await new Promise((resolve, reject) => {
    const timer = setTimeout(() => reject(new Error(`no address in time: ${said}`)), START_MS);
    child.stderr.on("data", (bytes) => {
      said = (said + bytes).slice(-20_000);
      const found = /(http:\/\/[^\s;]+)/.exec(said);
      if (found) {
        clearTimeout(timer);
        resolve(found[1]);
      }
    });
    ended.then((code) => reject(new Error(`the program ended with ${code}: ${said}`)));
  });
  const kill = async () => {
    child.kill("SIGKILL");
    await ended;
  };
  /** Memory that the program holds, bytes. */
  const resident = () => 1024 * Number(/VmRSS:\s+(\d+)/.exec(readFileSync(`/proc/${child.pid}/status`, "utf8"))[1]);
  return { url, port: Number(new URL(url).port), token: new URL(url).searchParams.get("token"), kill, resident, said: () => said };
}
