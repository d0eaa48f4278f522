// Vectors are arrays of three numbers, matrices Float32Arrays of 16 in column order, as WebGL wants them.
const add = (a, b) => a.map((v, k) => v + b[k]);
const subtract = (a, b) => a.map((v, k) => v - b[k]);
const scaled = (a, s) => a.map((v) => v * s);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => scaled(a, 1 / (length(a) || 1));
const mix = (a, b, t) => a + (b - a) * t;

/** Two directions that are level, given what is up. */
function levelAxes(up) {
  const side = Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const first = unit(subtract(side, scaled(up, dot(side, up))));
  return [first, cross(up, first)];
}

/** World to clip space for an eye that looks at a target. */
function viewProjection(eye, target, up, fovY, aspect, near, far) {
  const back = unit(subtract(eye, target));
  const right = unit(cross(up, back));
  const top = cross(back, right);
  const f = 1 / Math.tan(fovY / 2);
  const depth = [(far + near) / (near - far), (2 * far * near) / (near - far)];
  const view = [right, top, back].map((axis) => [...axis, -dot(axis, eye)]);
  const rows = [
    view[0].map((v) => (v * f) / aspect),
    view[1].map((v) => v * f),
    view[2].map((v, k) => v * depth[0] + (k === 3 ? depth[1] : 0)),
    view[2].map((v) => -v),
  ];
  return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
}
