// The settings of the run in a page, and what the page shows of them.
export type Value = string | number | boolean;

export const DEFAULTS: Readonly<Record<string, Value>> = {
  'scene.name': 'hand', 'packing.spheres': 1000, 'contact.method': 'field', 'coupling.stiffness': 400,
  'coupling.force_at_eighth': 10, 'friction.coefficient': 0.3, 'camera.noise': 1,
  'objects.shape': 'none', 'objects.right': 0, 'objects.down': 0, 'objects.away': 0,
};

export const RATE = 1000; // ticks per second
/** The limits of a device that is only displayed, as PageHandle::limits. */
export const DEVICE = {
  max_force: 10, max_torque: 0.6, max_stiffness: 400, max_angular_stiffness: 2, max_damping: 15, workspace_radius: 0.5,
  damping: 0.2, angular_damping: 1e-3, rate: RATE,
};

/** Returns the `controls` of a hello. */
export function controls(settings: Record<string, Value>, scenes: string[], objects: string[]): object[] {
  const number = (key: string, words: string, unit: string, low: number, high: number) => ({ key, words, unit, kind: 'number', low, high, whole: false, value: settings[key] });
  const choice = (key: string, words: string, choices: string[]) => ({ key, words, kind: 'choice', choices, value: String(settings[key]) });
  return [
    choice('contact.method', 'the depth field, or a method of the thesis: feel the difference', ['field', 'weighted', 'simplified', 'graph']),
    choice('packing.spheres', 'spheres that fill the tool', ['100', '300', '1000', '3000', '5000']),
    number('coupling.stiffness', 'of the spring between hand and tool', 'N/m', 50, 400),
    number('coupling.force_at_eighth', 'force at an eighth of the tool inside: how hard things are', 'N', 1, 40),
    number('friction.coefficient', 'friction', '', 0, 1.5),
    number('camera.noise', 'noise of the camera, as a share of that of a Kinect', '', 0, 3),
    choice('scene.name', 'what the camera sees', scenes),
    choice('objects.shape', 'a CAD object beside what the camera sees', objects),
    ...['right', 'down', 'away'].map((way) => number(`objects.${way}`, 'of the place where the object rests, in the image of the camera', 'm', -0.2, 0.2)),
  ];
}
