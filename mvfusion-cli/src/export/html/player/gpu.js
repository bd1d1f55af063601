// WebGL2: context, programs, textures and targets.

/** Why a page cannot be shown here; its message is for the reader. */
class Unsupported extends Error {}

/**
 * The context of a canvas.
 * @param {HTMLCanvasElement} canvas
 * @returns {WebGL2RenderingContext}
 */
function contextOf(canvas) {
  const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false });
  if (gl) return gl;
  throw new Unsupported('This browser offers no WebGL 2. Try a current version of Chrome, Firefox, Edge or Safari, '
    + 'and check that hardware acceleration is switched on.');
}

/**
 * Allows drawing into half-float targets; again after a context was lost.
 * @param {WebGL2RenderingContext} gl
 */
function allowHalfFloats(gl) {
  const names = ['EXT_color_buffer_float', 'EXT_color_buffer_half_float'];
  if (names.some(name => gl.getExtension(name)) || gl.isContextLost()) return;
  throw new Unsupported('This graphics driver cannot draw into half-float textures, which the blend of the two '
    + 'branches needs. Try another browser or another device.');
}

/**
 * A program.
 * @param {WebGL2RenderingContext} gl
 * @param {string} name of its shaders in the page, without `-vertex` and `-fragment`
 * @param {Object<string, number>} constants that its shaders are compiled with
 */
function programOf(gl, name, constants = {}) {
  const head = ['#version 300 es', ...Object.entries(constants).map(pair => `#define ${pair.join(' ')}`), ''];
  const program = gl.createProgram();
  for (const [kind, suffix] of [[gl.VERTEX_SHADER, 'vertex'], [gl.FRAGMENT_SHADER, 'fragment']]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, head.join('\n') + document.getElementById(`${name}-${suffix}`).textContent);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      const reason = gl.getShaderInfoLog(shader);
      throw new Unsupported(`This graphics driver refuses a shader (${name}, ${suffix}): ${reason}`);
    }
  }
  gl.bindAttribLocation(program, 0, 'index');
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Unsupported(`This graphics driver refuses a program (${name}): ${gl.getProgramInfoLog(program)}`);
  }
  const uniforms = {};
  for (let index = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) - 1; index >= 0; index--) {
    const uniform = gl.getActiveUniform(program, index).name;
    uniforms[uniform] = gl.getUniformLocation(program, uniform);
  }
  return { program, uniforms };
}

/**
 * A texture that is read texel by texel.
 * @param {WebGL2RenderingContext} gl
 * @param {{ internal: number, format: number, type: number }} kind
 * @param {number} width
 * @param {number} height
 * @param {ArrayBufferView | null} values
 */
function textureOf(gl, { internal, format, type }, width, height, values) {
  if (Math.max(width, height) > gl.getParameter(gl.MAX_TEXTURE_SIZE)) {
    throw new Unsupported(`The scene needs textures of ${width} x ${height} texels, which this graphics driver does `
      + 'not offer. Export it again with a smaller --size.');
  }
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, format, type, values);
  for (const [name, value] of [
    [gl.TEXTURE_MIN_FILTER, gl.NEAREST], [gl.TEXTURE_MAG_FILTER, gl.NEAREST],
    [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
  ]) gl.texParameteri(gl.TEXTURE_2D, name, value);
  return texture;
}

/** Half-float images to draw into together. */
class Target {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {number} images
   * @param {number} width
   * @param {number} height
   */
  constructor(gl, images, width, height) {
    this.gl = gl;
    this.frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    const kind = { internal: gl.RGBA16F, format: gl.RGBA, type: gl.HALF_FLOAT };
    this.textures = Array.from({ length: images }, () => textureOf(gl, kind, width, height, null));
    const attachments = this.textures.map((texture, index) => {
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + index, gl.TEXTURE_2D, texture, 0);
      return gl.COLOR_ATTACHMENT0 + index;
    });
    gl.drawBuffers(attachments);
    const state = gl.checkFramebufferStatus(gl.FRAMEBUFFER);
    if (state !== gl.FRAMEBUFFER_COMPLETE && !gl.isContextLost()) {
      throw new Unsupported(`This graphics driver cannot draw into ${images} half-float textures together (0x`
        + `${state.toString(16)}). Try another browser or another device.`);
    }
  }

  /** Draws into it from now on, over nothing. */
  begin() {
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, this.frame);
    this.gl.clearColor(0, 0, 0, 0);
    this.gl.clear(this.gl.COLOR_BUFFER_BIT);
  }

  free() {
    this.gl.deleteFramebuffer(this.frame);
    this.textures.forEach(texture => this.gl.deleteTexture(texture));
  }
}
