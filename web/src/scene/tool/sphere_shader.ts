// Spheres as impostors: each is one bounding rectangle on the canvas, and every pixel of it intersects
// the sphere exactly, with its depth. Spheres are round at any zoom and cost two triangles. Works for
// perspective views, also off-center ones, and orthographic views; the eye may be within a sphere.

import { BufferAttribute, InstancedBufferAttribute, InstancedBufferGeometry } from 'three';

/** place_ball() sets gl_Position; the rays then follow from `slope`. */
export const BALL_VERTEX = `
in vec2 corner;  // -1 or 1
in vec4 sphere;  // center and radius in the object's frame
out vec2 slope;           // perspective: of the ray, x and y per z; orthographic: x and y
flat out vec4 ball;       // center and radius in the view frame
flat out vec4 projection; // to compute depths: z, its offset, near plane, 1 if orthographic

const float FAR_OUT = 1e6;

// Range of slopes x / z at which a circle is seen from the origin, z forward: those of the tangents,
// the direction to the center u turned by the angle whose sine is r / distance.
bool tangents(vec2 center, float r, out vec2 interval) {
  float d = length(center);
  interval = vec2(-FAR_OUT, FAR_OUT);
  if (d <= r) return true;
  vec2 u = center / d;
  float s = r / d, c = sqrt(1.0 - s * s);
  vec2 low = vec2(u.x * c - u.y * s, u.y * c + u.x * s);
  vec2 high = vec2(u.x * c + u.y * s, u.y * c - u.x * s);
  if ((low.y <= 0.0 && low.x > 0.0) || (high.y <= 0.0 && high.x < 0.0)) return false;
  if (low.y > 0.0) interval.x = low.x / low.y;
  if (high.y > 0.0) interval.y = high.x / high.y;
  return true;
}

void hide_ball() { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); }

void place_ball() {
  mat4 P = projectionMatrix;
  bool flat_view = is_orthographic();
  ball = vec4((modelViewMatrix * vec4(sphere.xyz, 1.0)).xyz, sphere.w);
  projection = vec4(P[2][2], P[3][2], flat_view ? (P[3][2] + 1.0) / P[2][2] : P[3][2] / (P[2][2] - 1.0),
                    flat_view ? 1.0 : 0.0);
  vec2 scale = vec2(P[0][0], P[1][1]), offset = flat_view ? P[3].xy : -P[2].xy;
  vec2 x = ball.x + vec2(-ball.w, ball.w), y = ball.y + vec2(-ball.w, ball.w);
  if (!flat_view && !(tangents(vec2(ball.x, -ball.z), ball.w, x) && tangents(vec2(ball.y, -ball.z), ball.w, y))) {
    hide_ball();
    return;
  }
  vec2 edge = vec2(corner.x < 0.0 ? x.x : x.y, corner.y < 0.0 ? y.x : y.y);
  vec2 position = clamp(scale * edge + offset, -1.0, 1.0);
  slope = (position - offset) / scale;
  gl_Position = vec4(position, 0.0, 1.0);
}
`;

/**
 * The ray in the view frame is eye + t ray, with t the depth. It comes closest to the center at
 * t = closest, at the offset `nearest` from the center: precise even for small, distant spheres.
 */
export const BALL_FRAGMENT = `
in vec2 slope;
flat in vec4 ball;
flat in vec4 projection;

vec3 ray, nearest;
float closest, half_chord2; // the latter in units of the radius squared; negative: missed
float half_chord;           // in t

void meet_ball() {
  bool flat_view = projection.w == 1.0;
  ray = flat_view ? vec3(0.0, 0.0, -1.0) : vec3(slope, -1.0);
  vec3 to_center = ball.xyz - (flat_view ? vec3(slope, 0.0) : vec3(0.0));
  float length2 = dot(ray, ray);
  closest = dot(to_center, ray) / length2;
  nearest = closest * ray - to_center;
  half_chord2 = 1.0 - dot(nearest, nearest) / (ball.w * ball.w);
  half_chord = ball.w * sqrt(max(half_chord2, 0.0) / length2);
}

bool in_front(float t) { return t > projection.z; }

// Depth on the canvas, for gl_FragDepth.
float depth_of(float t) {
  float z = -t * projection.x + projection.y;
  return 0.5 + 0.5 * (projection.w == 1.0 ? z : z / t);
}
`;

/** Makes one rectangle for each sphere (x y z r). */
export function ballGeometry(spheres: Float32Array): InstancedBufferGeometry {
  const geometry = new InstancedBufferGeometry();
  geometry.setAttribute('corner', new BufferAttribute(new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), 2));
  geometry.setIndex([0, 1, 2, 2, 1, 3]);
  geometry.setAttribute('sphere', new InstancedBufferAttribute(spheres, 4));
  geometry.instanceCount = spheres.length / 4;
  return geometry;
}
