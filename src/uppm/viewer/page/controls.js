const FOV = 0.9;
const FLIGHT_MS = 700;
const STEEPEST = 1.5;

/** An eye that turns about a target; up stays up. */
class Camera {
  constructor(scene) {
    this.up = scene.up;
    this.axes = levelAxes(scene.up);
    this.aspect = 1;
    this.flight = null;
    const seen = scene.objects.filter((o) => o.center);
    const corners = seen.flatMap((o) => [-0.5, 0.5].map((s) => add(o.center, scaled(o.extent, s))));
    const low = [0, 1, 2].map((k) => Math.min(...corners.map((c) => c[k])));
    const high = [0, 1, 2].map((k) => Math.max(...corners.map((c) => c[k])));
    this.size = length(subtract(high, low));
    this.home = { target: scaled(add(low, high), 0.5), yaw: -1.1, pitch: 0.95, distance: 0.95 * this.size };
    Object.assign(this, this.home);
  }

  eye() {
    const level = add(scaled(this.axes[0], Math.cos(this.yaw)), scaled(this.axes[1], Math.sin(this.yaw)));
    const direction = add(scaled(level, Math.cos(this.pitch)), scaled(this.up, Math.sin(this.pitch)));
    return add(this.target, scaled(direction, this.distance));
  }

  clipFromMap() {
    const near = Math.max(0.02, this.distance / 50);
    return viewProjection(this.eye(), this.target, this.up, FOV, this.aspect, near, this.distance + 2 * this.size);
  }

  turn(dx, dy) {
    this.yaw -= dx * 0.006;
    this.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, this.pitch + dy * 0.006));
  }

  move(dx, dy) {
    const back = unit(subtract(this.eye(), this.target));
    const right = unit(cross(this.up, back));
    const perPixel = this.distance * 0.0012;
    this.target = add(this.target, add(scaled(right, -dx * perPixel), scaled(cross(back, right), dy * perPixel)));
  }

  nearer(factor) {
    this.distance = Math.min(5 * this.size, Math.max(0.1, this.distance * factor));
  }

  /** Fly to a place; `frame` is called for each picture on the way. */
  fly(goal, frame) {
    const from = { target: this.target, yaw: this.yaw, pitch: this.pitch, distance: this.distance };
    const start = performance.now();
    const flight = (this.flight = {});
    const step = (now) => {
      if (this.flight !== flight) return;
      const t = Math.min(1, Math.max(0, (now - start) / FLIGHT_MS));
      const eased = t * t * (3 - 2 * t);
      this.target = from.target.map((v, k) => mix(v, goal.target[k], eased));
      for (const key of ["yaw", "pitch", "distance"]) this[key] = mix(from[key], goal[key] ?? from[key], eased);
      frame();
      if (t < 1) requestAnimationFrame(step);
      else this.flight = null;
    };
    requestAnimationFrame(step);
  }

  flyTo(object, frame) {
    const distance = Math.max(1.2, 2.6 * length(object.extent));
    this.fly({ target: object.center, pitch: Math.max(this.pitch, 0.6), distance }, frame);
  }
}

/** Pointer and wheel on the canvas; a press that does not move is a click. */
function attachControls(canvas, camera, { redraw, click }) {
  let last = null;
  let travelled = 0;
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    camera.flight = null;
    canvas.setPointerCapture(event.pointerId);
    last = [event.clientX, event.clientY];
    travelled = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!last) return;
    const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
    last = [event.clientX, event.clientY];
    travelled += Math.abs(dx) + Math.abs(dy);
    if (event.shiftKey || event.buttons & 2) camera.move(dx, dy);
    else camera.turn(dx, dy);
    redraw();
  });
  canvas.addEventListener("pointerup", (event) => {
    if (last && travelled < 4) click(event);
    last = null;
  });
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      camera.flight = null;
      camera.nearer(Math.exp(event.deltaY * 0.001));
      redraw();
    },
    { passive: false },
  );
}
