// Are the types of the page right? Ends with 77, which CTest counts as skipped, where the packages
// are not installed.
import { spawnSync } from 'node:child_process';
import { existsSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const web = dirname(fileURLToPath(import.meta.url));
const tsc = join(web, 'node_modules', 'typescript', 'bin', 'tsc');
if (!existsSync(tsc)) {
  console.log('skipped: the packages of web/package-lock.json are not installed');
  process.exit(77);
}
process.exit(spawnSync(process.execPath, [tsc, '--noEmit', '-p', web], { stdio: 'inherit' }).status ?? 1);
