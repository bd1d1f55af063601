// Draws one time from a camera: each branch back to front into half-float images, then their blend.

/** Gaussians in a row of a texture; the same number stands in splat.vert.glsl. */
const COLUMNS = 256;
/** Texels of a Gaussian's state. */
const STATE_TEXELS = 4;
const LAYERS = ['composed', 'static', 'dynamic', 'mask'];

/**
 * The states of the Gaussians at a keyframe, as splat.vert.glsl reads them.
 * @param {Branch} branch
 * @param {number} k
 * @returns {Float32Array}
 */
function statesAt({ count, tracks }, k) {
  const width = 4 * STATE_TEXELS;
  const states = new Float32Array(width * COLUMNS * Math.max(1, Math.ceil(count / COLUMNS)));
  const put = ({ columns, offset, step }, first) => columns.forEach((column, index) => {
    for (let row = 0; row < count; row++) states[width * row + first + index] = offset + step * column[k * count + row];
  });
  put(tracks.mean, 0);
  put(tracks.opacity, 3);
  put(tracks.log_scale, 4);
  put(tracks.rotation, 8);
  put(tracks.sh_dc, 12);
  if (tracks.mask) {
    // Two bytes in a float.
    const { columns, offset, step } = tracks.mask;
    const byte = level => Math.min(255, Math.max(0, Math.round(255 * (offset + step * level))));
    for (let row = 0; row < count; row++) {
      const [static_, dynamic] = columns.map(column => byte(column[k * count + row]));
      states[width * row + 7] = static_ + 256 * dynamic;
    }
    // The brightness has finer steps, because its slope is steep (blend.frag.glsl).
    put(tracks.brightness, 15);
  }
  return states;
}

/** A branch on the GPU, and the order in which it is drawn. */
class BranchOnGpu {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Branch} branch
   */
  constructor(gl, branch) {
    Object.assign(this, { gl, branch, states: new Map(), drawn: 0 });
    this.rows = Math.max(1, Math.ceil(branch.count / COLUMNS));
    const constants = branch.tracks.mask ? { DEGREE: branch.degree, MASKS: 1 } : { DEGREE: branch.degree };
    this.program = programOf(gl, 'splat', constants);
    this.rest = this.restTexture();
    this.order = gl.createBuffer();
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
  }

  restTexture() {
    const { gl, branch: { count, tracks: { sh_rest: rest } } } = this;
    if (!rest.columns.length) return null;
    const texels = Math.ceil(rest.columns.length / 4);
    const values = new Int16Array(4 * texels * COLUMNS * this.rows);
    rest.columns.forEach((column, index) => {
      for (let row = 0; row < count; row++) values[4 * texels * row + index] = column[row];
    });
    const kind = { internal: gl.RGBA16I, format: gl.RGBA_INTEGER, type: gl.SHORT };
    return textureOf(gl, kind, texels * COLUMNS, this.rows, values);
  }

  /** The texture of a keyframe. The two that were used last are kept. */
  stateTexture(k) {
    const { gl, states } = this;
    const known = states.get(k);
    states.delete(k);
    const kind = { internal: gl.RGBA32F, format: gl.RGBA, type: gl.FLOAT };
    states.set(k, known ?? textureOf(gl, kind, STATE_TEXELS * COLUMNS, this.rows, statesAt(this.branch, k)));
    if (states.size > 2) {
      const [oldest] = states.keys();
      gl.deleteTexture(states.get(oldest));
      states.delete(oldest);
    }
    return states.get(k);
  }

  /** @param {Uint32Array} order the Gaussians to draw, the farthest first */
  sort(order) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.bufferData(gl.ARRAY_BUFFER, order, gl.DYNAMIC_DRAW);
    this.drawn = order.length;
  }

  /**
   * @param {Camera} camera
   * @param {number} time
   * @param {number} near
   */
  draw(camera, time, near) {
    const { gl, branch, program: { program, uniforms } } = this;
    const { before, after, weight } = bracketOf(branch.times, time);
    const [first, second] = [this.stateTexture(before), this.stateTexture(after)];
    gl.useProgram(program);
    [[first, 'before'], [second, 'after'], [this.rest, 'rest']].forEach(([texture, name], unit) => {
      if (!uniforms[name]) return;
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(uniforms[name], unit);
    });
    const { rotation, translation } = camera;
    const eye = [0, 1, 2].map(axis => -dot([rotation[axis], rotation[axis + 3], rotation[axis + 6]], translation));
    gl.uniform1f(uniforms.weight, weight);
    gl.uniform1f(uniforms.restStep, branch.tracks.sh_rest.step);
    gl.uniformMatrix3fv(uniforms.rotation, true, rotation);
    gl.uniform3fv(uniforms.translation, translation);
    gl.uniform3fv(uniforms.eye, eye);
    gl.uniform2f(uniforms.focal, camera.fx, camera.fy);
    gl.uniform2f(uniforms.principal, camera.cx, camera.cy);
    gl.uniform2f(uniforms.size, camera.width, camera.height);
    gl.uniform1f(uniforms.near, near);
    gl.bindVertexArray(this.array);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.drawn);
    gl.disable(gl.BLEND);
  }
}

/** Draws a scene. */
class Renderer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {object} scene
   * @param {Branch[]} branches the static one first if there is one
   */
  constructor(canvas, scene, branches) {
    Object.assign(this, { canvas, scene, branches, size: '', tickets: 0, waiting: new Map() });
    this.gl = contextOf(canvas);
    const source = new Blob([document.getElementById('sorter').textContent], { type: 'text/javascript' });
    this.worker = new Worker(URL.createObjectURL(source));
    this.worker.onmessage = ({ data: { ticket, order } }) => {
      this.waiting.get(ticket)(order);
      this.waiting.delete(ticket);
    };
    this.worker.onerror = ({ message }) => showMessage(`The Gaussians cannot be sorted: ${message}`);
    this.create();
  }

  /** Everything on the GPU; again after a context was lost. */
  create() {
    const { gl } = this;
    allowHalfFloats(gl);
    Object.assign(this, { size: '', targets: null });
    this.onGpu = this.branches.map(branch => new BranchOnGpu(gl, branch));
    this.blend = programOf(gl, 'blend');
    this.nothing = gl.createVertexArray();
    this.sent = this.branches.map(() => null);
  }

  /** Sorts the Gaussians of each branch for a camera and a time. Resolves when their orders are in use. */
  async sort({ rotation, translation }, time) {
    const axis = [...row(rotation, 2), translation[2]];
    const { near } = this.scene;
    const orders = await Promise.all(this.branches.map((branch, index) => {
      const bracket = bracketOf(branch.times, time);
      const name = Object.values(bracket).join();
      const points = this.sent[index] === name ? null : centresAt(branch, bracket);
      this.sent[index] = name;
      const ticket = this.tickets++;
      this.worker.postMessage({ ticket, branch: index, points, axis, near }, points ? [points.buffer] : []);
      return new Promise(resolve => this.waiting.set(ticket, resolve));
    }));
    orders.forEach((order, index) => this.onGpu[index].sort(order));
  }

  /** Draws into the canvas with the orders in use. */
  draw(camera, time, layer) {
    const { gl, scene, blend: { program, uniforms } } = this;
    if (gl.isContextLost()) return;
    this.resize(camera.width, camera.height);
    gl.viewport(0, 0, camera.width, camera.height);
    this.onGpu.forEach((branch, index) => {
      this.targets[index].begin();
      branch.draw(camera, time, scene.near);
    });
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.useProgram(program);
    const dynamic = this.targets.at(-1).textures;
    const isBlended = this.targets.length > 1 && dynamic.length > 1;
    const [staticColour] = this.targets[0].textures;
    const textures = { staticColour, dynamicColour: dynamic[0], dynamicMask: dynamic.at(-1) };
    Object.entries(textures).forEach(([name, texture], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(uniforms[name], unit);
    });
    gl.uniform1f(uniforms.grey, scene.grey);
    gl.uniform3fv(uniforms.masks, scene.masks);
    gl.uniform1i(uniforms.isBlended, Number(isBlended));
    gl.uniform1i(uniforms.layer, LAYERS.indexOf(layer));
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** The pixels of the canvas, from the top; right after a draw. */
  read() {
    const { gl, canvas: { width, height } } = this;
    const upwards = new Uint8ClampedArray(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(upwards.buffer));
    const pixels = new Uint8ClampedArray(upwards.length);
    for (let y = 0; y < height; y++) {
      pixels.set(upwards.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    }
    return new ImageData(pixels, width, height);
  }

  resize(width, height) {
    const size = `${width} ${height}`;
    if (this.size === size) return;
    Object.assign(this.canvas, { width, height });
    this.targets?.forEach(target => target.free());
    // Without a size, a driver that offers no such targets is asked again.
    Object.assign(this, { size: '', targets: null });
    this.targets = this.branches.map(({ tracks }) => new Target(this.gl, tracks.mask ? 2 : 1, width, height));
    this.size = size;
  }
}
