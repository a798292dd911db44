// The hash of a weld's geometry, for publishers that want to state it: `node profile_sha256.mjs FILE.json`.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";

const { x_m, z_m } = JSON.parse(readFileSync(process.argv[2], "utf8"));
const samples = [...x_m, ...z_m];
const bytes = new DataView(new ArrayBuffer(8 * samples.length));
samples.forEach((value, i) => bytes.setFloat64(8 * i, value + 0, true)); // + 0: -0 counts as 0
console.log(createHash("sha256").update(new Uint8Array(bytes.buffer)).digest("hex"));
