// Worlds of which a test knows what must be seen. W: x right, y down, z away from the camera.

/// One control of each kind, and those that a haptic run has most use for.
export const controls = [
  { key: 'contact.method', words: 'how a sphere is measured', kind: 'choice', value: 'field',
    choices: ['weighted', 'simplified', 'graph', 'field'] },
  { key: 'loop.backend', words: 'where it is computed', kind: 'choice', value: 'cpu',
    choices: ['cpu', 'cuda'] },
  { key: 'coupling.stiffness', words: 'of the spring to the hand, N/m', kind: 'number', value: 800,
    low: 0, high: 3000 },
  { key: 'coupling.damping', words: 'part of the critical damping', kind: 'number', value: 0.7,
    low: 0, high: 2 },
  { key: 'objects.block.friction', words: 'of this object; auto: that of everything else', kind: 'number',
    value: 'auto', low: 0, high: 10, choices: ['auto'] },
  { key: 'surface.filter', words: 'smooth the depth image', kind: 'switch', value: true },
];

const stream = { width: 160, height: 120, focal: 140 };

/// One sphere of 50 mm around the tool's origin.
export const radius = 0.05;
export const oneSphere = {
  kind: 'live', title: 'one sphere', stream, controls,
  spheres: [[0, 0, 0, radius]], shape: { name: 'sphere', size: 2 * radius },
};

/// Three of 20 mm side by side, in the order of the states: outside, boundary, inside.
export const threeSpheres = {
  ...oneSphere, title: 'three spheres',
  spheres: [[-0.05, 0, 0, 0.02], [0, 0, 0, 0.02], [0.05, 0, 0, 0.02]],
  shape: { name: 'box', size: 0.15 },
};

/// No plane cuts it.
export const uncut = [0, 0, 0, 0];

/// Little of everything, all of it moving.
export const lively = {
  contact: { position: [0, 0, 0.45], states: [1], planes: [[0, 0, -1, 0]] },
  depth: [[0, 0.45], [80, 0.7]],
  sample: { force: [0.5, -1, 2], contact_force: [0, 0, -3], volume: 2e-4, hand: [0.01, 0, 0.43] },
  moving: true,
};

/// Much of everything: an image as large as a camera's, 2000 spheres, all of it moving.
export const busy = {
  ...oneSphere, title: 'busy', stream: { width: 640, height: 480, focal: 560 },
  spheres: Array.from({ length: 2000 }, (_, i) => [
    0.004 * (i % 20) - 0.04, 0.004 * (Math.floor(i / 20) % 10) - 0.02,
    0.004 * Math.floor(i / 200) - 0.02, 0.0018]),
  shape: { name: 'box', size: 0.1 },
};
export const busyNow = {
  contact: {
    position: [0, 0, 0.5],
    states: busy.spheres.map((_, i) => i % 3),
    planes: busy.spheres.map(([x, y, z], i) => (i % 3 === 1 ? [0, 0, -1, -z] : uncut)),
  },
  depth: [[0, 0.55], [300, 0.75], [340, 0], [360, 0.6]],
  sample: { force: [0.5, -1, 2], contact_force: [0, 0, -3], volume: 2e-5, hand: [0.01, 0, 0.48] },
  moving: true,
};
