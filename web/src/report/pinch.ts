// Pinch zoom of plots; one finger scrolls the page.

import type uPlot from 'uplot';

export function pinchToZoom(chart: uPlot, zoom: (range: [number, number]) => void): void {
  /** Values of x under both fingers when they came down. */
  let held: [number, number] | null = null;
  const places = (event: TouchEvent): [number, number] => {
    const { left } = chart.over.getBoundingClientRect();
    const x = [event.touches[0].clientX - left, event.touches[1].clientX - left];
    return x[0] < x[1] ? [x[0], x[1]] : [x[1], x[0]];
  };
  chart.over.style.touchAction = 'pan-y';
  chart.over.addEventListener('touchstart', (event) => {
    const [a, b] = event.touches.length === 2 ? places(event) : [0, 0];
    held = b - a > 10 ? [chart.posToVal(a, 'x'), chart.posToVal(b, 'x')] : null;
  }, { passive: true });
  chart.over.addEventListener('touchmove', (event) => {
    if (!held || event.touches.length !== 2) return;
    event.preventDefault();
    const [a, b] = places(event), width = chart.over.clientWidth;
    if (b - a < 10) return;
    // Logarithmic axes are zoomed in the logarithm.
    const isLogarithmic = chart.scales.x.distr === 3;
    const [u, v] = isLogarithmic ? held.map(Math.log) : held;
    const perPixel = (v - u) / (b - a);
    const range = [u - a * perPixel, v + (width - b) * perPixel];
    zoom((isLogarithmic ? range.map(Math.exp) : range) as [number, number]);
  });
}
