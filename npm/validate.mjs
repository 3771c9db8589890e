// The Khronos validator's report on a glTF file, as JSON: node validate.mjs FILE
import { readFileSync } from "node:fs";
import { argv, stdout } from "node:process";
import validator from "gltf-validator";

const report = await validator.validateBytes(new Uint8Array(readFileSync(argv[2])), { maxIssues: 100 });
stdout.write(JSON.stringify(report));
