const HIGHLIGHT = [1.0, 0.5, 0.05];
const BEST = [1.0, 0.2, 0.1];
const DIMMED = 0.2;

const VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 color;
uniform mat4 clipFromMap;
uniform float pointSize;
out vec3 n;
out vec3 c;
void main() {
  gl_Position = clipFromMap * vec4(position, 1.0);
  gl_PointSize = pointSize;
  n = normal;
  c = color;
}`;

// Light falls from the eye, and some from above: surfaces that face away from both stay readable.
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 n;
in vec3 c;
uniform vec4 flatColor;  // a: share of it, against the surface's own colour
uniform vec3 toEye;
uniform vec3 up;
uniform float alpha;
uniform float lit;
out vec4 color;
void main() {
  float size = length(n);
  vec3 at = size > 0.0 ? n / size : toEye;  // lines and points have no normal
  float light = 0.55 + 0.35 * max(dot(at, toEye), 0.0) + 0.12 * dot(at, up);
  color = vec4(mix(c, flatColor.rgb, flatColor.a) * mix(1.0, light, lit), alpha);
}`;

/** Draws the map; knows nothing of the page around its canvas. */
class SceneView {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.gl = canvas.getContext("webgl2", { alpha: false, antialias: true, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("This browser has no WebGL 2, which the picture needs.");
    this.program = this.linked(VERTEX, FRAGMENT);
    const names = ["clipFromMap", "pointSize", "flatColor", "toEye", "up", "alpha", "lit"];
    this.uniforms = Object.fromEntries(names.map((name) => [name, this.gl.getUniformLocation(this.program, name)]));
    this.surfaces = this.vertexArray(scene.positions, scene.normals, scene.pointColors);
    const elements = this.gl.createBuffer();
    this.gl.bindBuffer(this.gl.ELEMENT_ARRAY_BUFFER, elements);
    this.gl.bufferData(this.gl.ELEMENT_ARRAY_BUFFER, scene.indices, this.gl.STATIC_DRAW);
    this.free = this.vertexArray(scene.freePositions);
    this.pathPoints = new Float32Array(scene.path.flatMap((p) => [p[4], p[8], p[12]]));
    this.path = this.vertexArray(this.pathPoints);
    this.frustum = this.vertexArray(new Float32Array(48));
  }

  linked(...sources) {
    const gl = this.gl;
    const program = gl.createProgram();
    sources.forEach((source, k) => {
      const shader = gl.createShader(k ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  /** Positions, and normals and colours where there are any. */
  vertexArray(positions, normals, colors) {
    const gl = this.gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    [[positions, gl.FLOAT, false], [normals, gl.BYTE, true], [colors, gl.UNSIGNED_BYTE, true]].forEach(
      ([data, type, normalized], location) => {
        if (!data) return;
        const buffer = gl.createBuffer();
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
        gl.enableVertexAttribArray(location);
        gl.vertexAttribPointer(location, 3, type, normalized, 0, 0);
        if (!location) array.buffer = buffer;
      },
    );
    return array;
  }

  /** One picture of the scene: what is dimmed last, so that answers show through it. */
  draw(camera, state) {
    const gl = this.gl;
    this.begin(camera, [0.925, 0.933, 0.949, 1]);
    gl.bindVertexArray(this.surfaces);
    const asked = state.answers.size > 0;
    for (const object of this.scene.objects) {
      if (!state.isVisible(object) || (asked && !state.answers.has(object.id))) continue;
      gl.uniform4f(this.uniforms.flatColor, ...this.colorOf(object, state));
      this.drawObject(object);
    }
    this.drawExtras(state);
    if (!asked) return;
    gl.bindVertexArray(this.surfaces);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.uniform1f(this.uniforms.lit, 1);
    gl.uniform1f(this.uniforms.alpha, DIMMED);
    gl.uniform4f(this.uniforms.flatColor, 0.35, 0.37, 0.42, 1);
    for (const object of this.scene.objects) {
      if (state.isVisible(object) && !state.answers.has(object.id)) this.drawObject(object);
    }
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  begin(camera, background) {
    const gl = this.gl;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...background);
    gl.enable(gl.DEPTH_TEST);
    // Walls and ceilings are left out where they are seen from behind: one looks into the rooms.
    gl.enable(gl.CULL_FACE);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.uniforms.clipFromMap, false, camera.clipFromMap());
    gl.uniform3fv(this.uniforms.toEye, unit(subtract(camera.eye(), camera.target)));
    gl.uniform3fv(this.uniforms.up, this.scene.up);
    gl.uniform1f(this.uniforms.pointSize, 4);
    gl.uniform1f(this.uniforms.alpha, 1);
    gl.uniform1f(this.uniforms.lit, 1);
  }

  colorOf(object, state) {
    if (object.id === state.selected || object.id === state.best) return [...BEST, 0.62];
    if (state.answers.has(object.id)) return [...HIGHLIGHT, 0.55];
    if (state.coloring === "texture") return [0, 0, 0, 0];
    return [...object.colors[state.coloring].map((v) => v / 255), 1];
  }

  drawObject(object) {
    this.gl.drawElements(this.gl.TRIANGLES, 3 * object.triangles, this.gl.UNSIGNED_INT, 4 * object.firstCorner);
  }

  /** Freespace as points, the camera's way as a line, the camera of the chosen frame as a pyramid. */
  drawExtras(state) {
    const gl = this.gl;
    gl.uniform1f(this.uniforms.lit, 0);
    if (state.free) {
      gl.bindVertexArray(this.free);
      gl.uniform4f(this.uniforms.flatColor, 0.2, 0.55, 0.85, 1);
      gl.drawArrays(gl.POINTS, 0, this.scene.freePositions.length / 3);
    }
    if (state.path) {
      const frames = this.scene.path.filter((p) => p[0] <= state.time);
      gl.uniform4f(this.uniforms.flatColor, 0.1, 0.1, 0.6, 1);
      gl.bindVertexArray(this.path);
      gl.drawArrays(gl.LINE_STRIP, 0, frames.length);
      if (frames.length) this.drawFrustum(frames[frames.length - 1]);
    }
    gl.uniform1f(this.uniforms.lit, 1);
  }

  drawFrustum(pose) {
    const gl = this.gl;
    const at = (x, y, z) => [0, 1, 2].map((r) => pose[1 + 4 * r] * x + pose[2 + 4 * r] * y + pose[3 + 4 * r] * z + pose[4 + 4 * r]);
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => at(0.16 * x, 0.12 * y, 0.24));
    const lines = corners.flatMap((corner, k) => [at(0, 0, 0), corner, corner, corners[(k + 1) % 4]]);
    gl.bindVertexArray(this.frustum);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.frustum.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(lines.flat()), gl.DYNAMIC_DRAW);
    gl.drawArrays(gl.LINES, 0, 16);
  }

  /** The object at a pixel, its top left the origin; null for none. Each is drawn once more in a colour of its own. */
  pick(camera, state, x, y) {
    const gl = this.gl;
    const row = this.canvas.height - 1 - y;
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(x, row, 1, 1);
    this.begin(camera, [0, 0, 0, 1]);
    gl.uniform1f(this.uniforms.lit, 0);
    gl.bindVertexArray(this.surfaces);
    this.scene.objects.forEach((object, k) => {
      if (!state.isVisible(object)) return;
      const code = k + 1;
      gl.uniform4f(this.uniforms.flatColor, (code & 255) / 255, ((code >> 8) & 255) / 255, (code >> 16) / 255, 1);
      this.drawObject(object);
    });
    const pixel = new Uint8Array(4);
    gl.readPixels(x, row, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    gl.disable(gl.SCISSOR_TEST);
    return this.scene.objects[pixel[0] + 256 * pixel[1] + 65536 * pixel[2] - 1] || null;
  }
}
