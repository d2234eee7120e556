// The hand of a page as a handle: it follows the pointer like a critically damped spring, as src/devices/software does.

export type Numbers = number[]; // x y z, or x y z qx qy qz qw

const FOLLOW = 60; // 1/s
const FASTEST = 1, FASTEST_TURN = 10; // m/s, rad/s

/** Returns the way in `seconds` of a damped spring to a target at `away`, and its velocity then. */
function followed(away: Numbers, velocity: Numbers, fastest: number, seconds: number): { way: Numbers; velocity: Numbers } {
  const length = Math.hypot(...away), most = (2 * fastest) / FOLLOW;
  const y = away.map((a) => -a * (length > most ? most / length : 1));
  const rate = y.map((a, i) => velocity[i] + FOLLOW * a), decay = Math.exp(-FOLLOW * seconds);
  return {
    way: y.map((a, i) => (a + rate[i] * seconds) * decay - a),
    velocity: rate.map((r, i) => (velocity[i] - r * FOLLOW * seconds) * decay),
  };
}

export function product(a: Numbers, b: Numbers): Numbers {
  const [x, y, z, w] = a, [p, q, r, s] = b;
  const c = [w * p + x * s + y * r - z * q, w * q - x * r + y * s + z * p, w * r + x * q - y * p + z * s, w * s - x * p - y * q - z * r];
  const length = Math.hypot(...c);
  return c.map((n) => n / length);
}
/** Returns a vector turned by a unit quaternion: v + 2 u x (u x v + w v), u its vector. */
export function rotated([x, y, z, w]: Numbers, [a, b, c]: Numbers): Numbers {
  const [p, q, r] = [y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c];
  return [a + 2 * (y * r - z * q), b + 2 * (z * p - x * r), c + 2 * (x * q - y * p)];
}
/** Returns a point at a pose. */
export const composed = (X: Numbers, p: Numbers): Numbers => rotated(X.slice(3), p).map((x, i) => x + X[i]);
export const conjugate = ([x, y, z, w]: Numbers): Numbers => [-x, -y, -z, w];

function rotationVector(q: Numbers): Numbers {
  const [x, y, z, w] = q[3] < 0 ? q.map((n) => -n) : q, sine = Math.hypot(x, y, z);
  const scale = sine > 1e-9 ? (2 * Math.atan2(sine, w)) / sine : 2;
  return [x * scale, y * scale, z * scale];
}
function quaternion(v: Numbers): Numbers {
  const angle = Math.hypot(...v), scale = angle > 1e-9 ? Math.sin(angle / 2) / angle : 0.5;
  return [v[0] * scale, v[1] * scale, v[2] * scale, Math.cos(angle / 2)];
}

export class Follower {
  linear = [0, 0, 0];
  angular = [0, 0, 0];
  private shift = [0, 0, 0];
  private turn = [0, 0, 0, 1];
  private target: Numbers;
  private isReference = true;

  constructor(public pose: Numbers) {
    this.target = pose;
  }

  /** The next pose of the page stands for the present one and moves nothing. */
  grip(): void {
    this.isReference = true;
  }
  move(to: Numbers): void {
    if (this.isReference) {
      this.shift = [0, 1, 2].map((i) => this.pose[i] - to[i]);
      this.turn = product(this.pose.slice(3), conjugate(to.slice(3)));
      this.isReference = false;
    }
    this.target = [...[0, 1, 2].map((i) => to[i] + this.shift[i]), ...product(this.turn, to.slice(3))];
  }
  stop(): void {
    this.linear = [0, 0, 0];
    this.angular = [0, 0, 0];
    this.target = this.pose;
  }
  step(seconds: number): void {
    const { pose, target } = this;
    const moved = followed([0, 1, 2].map((i) => target[i] - pose[i]), this.linear, FASTEST, seconds);
    const turned = followed(
      rotationVector(product(target.slice(3), conjugate(pose.slice(3)))), this.angular, FASTEST_TURN, seconds);
    this.pose = [...[0, 1, 2].map((i) => pose[i] + moved.way[i]), ...product(quaternion(turned.way), pose.slice(3))];
    this.linear = moved.velocity;
    this.angular = turned.velocity;
  }
}
