// Vibration of what holds the tool: a gamepad's strong motor is as strong as the force, its weak one and a phone vibrate as fast
// as the force changes, so that a touch is a click and a steady push is still.
import { norm } from '../format';

const INTERVAL = 90; // ms
const LEAST = 0.01;  // share that is felt
const FASTEST = 3;   // 1/s: change of the force, over the largest, at full vibration
const SHORTEST_PULSE = 10, LONGEST_PULSE = 60; // ms: shorter ones do not move a phone

/** A controller of a headset. */
type Controller = Gamepad & { hapticActuators?: { pulse(strength: number, ms: number): Promise<unknown> }[] };

export class Vibration {
  private begun = -Infinity; // ms
  private share = [0, 0, 0];

  /** Follows the force, given as a share of the largest. */
  follow(share: [number, number, number], pad: Gamepad | null): void {
    const now = performance.now(), interval = now - this.begun;
    if (interval < INTERVAL) return;
    const [x, y, z] = share.map((value, i) => value - this.share[i]);
    const strong = Math.min(1, norm(...share)), change = Math.min(1, (1000 * norm(x, y, z)) / (interval * FASTEST));
    this.begun = now;
    this.share = share;
    if (Math.max(strong, change) < LEAST) return;
    const motor = (pad as Controller | null)?.hapticActuators?.[0];
    if (motor && change >= LEAST) void motor.pulse(change, 1.3 * INTERVAL)?.catch(() => {});
    if (!motor) void pad?.vibrationActuator?.playEffect?.('dual-rumble', { duration: 1.3 * INTERVAL, strongMagnitude: strong, weakMagnitude: change })
      .catch(() => {}); // a gamepad without motors
    if (change >= LEAST) navigator.vibrate?.(Math.round(SHORTEST_PULSE + (LONGEST_PULSE - SHORTEST_PULSE) * change));
  }
  /** Begins anew: nobody holds the tool. */
  stop(): void {
    this.begun = -Infinity;
    this.share = [0, 0, 0];
  }
}
