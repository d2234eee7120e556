import { defineConfig } from 'vite';
import type { Plugin } from 'vite';

/// lil-gui brings a font for four signs that every font has; a strict page loads no fonts.
const withoutFonts: Plugin = {
  name: 'without-fonts',
  enforce: 'pre',
  transform: (code, id) => (id.endsWith('lil-gui.css') ? code.replace(/@font-face\s*{[^}]*}/g, '') : undefined),
};

/// `npx vite` serves the page as it is being written, with all else from a running `palpate view`.
const program = 'http://127.0.0.1:8787';

// The viewer's page, with --mode report the script of all reports, or with --mode try that of the page without a program. One script and one style
// sheet each, named without hashes: they are built into the program.
export default defineConfig(({ mode }) => {
  const name = mode === 'report' || mode === 'try' ? mode : 'page';
  return {
    base: './',
    plugins: [withoutFonts],
    publicDir: name === 'page' ? 'public' : false,
    server: { proxy: { '/api': program, '/ws': { target: program, ws: true } } },
    build: {
      target: 'es2022',
      modulePreload: false,
      cssCodeSplit: false,
      assetsInlineLimit: 0,
      chunkSizeWarningLimit: 1500, // kB
      rollupOptions: {
        input: name === 'page' ? 'index.html' : `src/${name}/main.ts`,
        output: {
          format: name === 'page' ? 'es' : 'iife',
          inlineDynamicImports: true,
          entryFileNames: `${name}.js`,
          assetFileNames: (asset) => (asset.names[0]?.endsWith('.css') ? `${name}.css` : '[name][extname]'),
        },
      },
    },
  };
});
