"use strict";
// Pictures of a light field, rendered by WebGL 2 from its views and their depths: refocused, and from other viewpoints.
// The geometry is that of mirrorcam.optics.light_field.render: in every pinhole, a pixel stands for a point of the
// reference plane, and q is inverse distance in 1/mm from the reference view.
(() => {
  const VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

  const shared = (about) => `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
const int ROWS = ${about.grid[0]}, COLS = ${about.grid[1]}, STEP = ${about.step};
const int DENSE_ROWS = (ROWS - 1) * STEP + 1, DENSE_COLS = (COLS - 1) * STEP + 1;
const vec2 SIZE = vec2(${about.size_px}), CENTRE = vec2(${about.centre_px});
const float FOCAL = float(${about.focal_px}), REFERENCE = float(${about.reference_inverse_mm});
const float FAR = float(${about.inverse_mm[0]}), NEAR = float(${about.inverse_mm[1]});
const float TOLERANCE = float(${about.tolerance_per_mm});
const vec3 UNSEEN = vec3(0.25);
uniform sampler2D views, valid, depths;
uniform vec3 positions[DENSE_ROWS * DENSE_COLS];
out vec4 colour;

// The pixel of the pinhole at end that shows the point which the pinhole at start shows in a pixel, at q.
vec2 moved(vec2 pixel, vec3 start, vec3 end, float q) {
  float scaleStart = (1.0 - start.z * q) / (1.0 - start.z * REFERENCE);
  float scaleEnd = (1.0 - end.z * REFERENCE) / (1.0 - end.z * q);
  vec2 point = (start.xy - end.xy) * q + ((pixel - CENTRE) / FOCAL - start.xy * REFERENCE) * scaleStart;
  return FOCAL * (end.xy * REFERENCE + point * scaleEnd) + CENTRE;
}
bool inside(vec2 pixel) { return all(greaterThanEqual(pixel, vec2(0.0))) && all(lessThanEqual(pixel, SIZE - 1.0)); }
vec2 inDense(ivec2 view, vec2 pixel) { return (vec2(view) + (pixel + 0.5) / SIZE) / vec2(DENSE_COLS, DENSE_ROWS); }
vec3 positionOf(ivec2 view) { return positions[view.y * DENSE_COLS + view.x]; }
vec3 light(vec3 level) { return mix(level / 12.92, pow((level + 0.055) / 1.055, vec3(2.4)), step(0.04045, level)); }
vec3 levels(vec3 light) { return mix(light * 12.92, 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, light)); }
vec2 here() { return vec2(gl_FragCoord.x - 0.5, SIZE.y - gl_FragCoord.y - 0.5); }
`;

  const REFOCUS = `
uniform float q;
void main() {
  vec4 total = vec4(0.0);
  for (int t = 0; t < DENSE_ROWS; t++) for (int s = 0; s < DENSE_COLS; s++) {
    ivec2 view = ivec2(s, t);
    vec2 pixel = moved(here(), vec3(0.0), positionOf(view), q);
    if (!inside(pixel)) continue;
    vec2 at = inDense(view, pixel);
    total += vec4(light(texture(views, at).rgb), 1.0) * texture(valid, at).r;
  }
  colour = vec4(total.a > 0.0 ? levels(total.rgb / total.a) : UNSEEN, 1.0);
}`;

  const DEPTHS = `
uniform vec3 viewpoint;
vec2 depthAt(ivec2 view, vec2 pixel) {
  vec4 texel = texelFetch(depths, view * ivec2(SIZE) + ivec2(pixel + 0.5), 0);
  return vec2(mix(FAR, NEAR, texel.r), texel.g);
}`;

  // The first surface along each ray is where a view's depth meets it, from near to far, in the four views around the
  // viewpoint. Its q is stored in 16 bits.
  const SURFACE = `${DEPTHS}
uniform ivec2 cell;
const int STEPS = 64;
float surface(vec2 pixel) {
  float width = (NEAR - FAR) / float(STEPS), slack = (NEAR - FAR) / 255.0;
  for (int i = 0; i <= STEPS; i++) {
    float q = NEAR - float(i) * width;
    vec2 total = vec2(0.0);
    for (int k = 0; k < 4; k++) {
      ivec2 view = min(cell + ivec2(k & 1, k >> 1), ivec2(COLS, ROWS) - 1);
      vec3 position = positionOf(view * STEP);
      vec2 at = moved(pixel, viewpoint, position, q);
      if (!inside(at)) continue;
      float depth = depthAt(view, at).x;
      vec2 apart = position.xy - viewpoint.xy;
      if (depth >= q - slack && depth <= q + width + slack) total += vec2(depth, 1.0) / (dot(apart, apart) + 1.0);
    }
    if (total.y > 0.0) return total.x / total.y;
  }
  return FAR;
}
void main() {
  float level = clamp((surface(here()) - FAR) / (NEAR - FAR), 0.0, 1.0) * 255.0;
  colour = vec4(floor(level) / 255.0, fract(level), 0.0, 1.0);
}`;

  // The colour of a surface comes from the views whose depth agrees, near viewpoints first. The median of q over 3 x 3
  // pixels closes the cracks that rays between two pixels of a depth map leave.
  const COLOUR = `${DEPTHS}
uniform sampler2D surfaces;
const float UNMEASURED = 0.01, CONTRADICTING = 0.0001, NEAREST = 0.01;
float median() {
  float q[9];
  for (int i = 0; i < 9; i++) {
    ivec2 at = clamp(ivec2(gl_FragCoord.xy) + ivec2(i % 3, i / 3) - 1, ivec2(0), ivec2(SIZE) - 1);
    vec4 texel = texelFetch(surfaces, at, 0);
    float value = texel.r + texel.g / 255.0;
    int place = i;
    for (; place > 0 && q[place - 1] > value; place--) q[place] = q[place - 1];
    q[place] = value;
  }
  return mix(FAR, NEAR, q[4]);
}
void main() {
  float q = median();
  vec4 total = vec4(0.0);
  vec3 across = positionOf(ivec2(DENSE_COLS, DENSE_ROWS) - 1) - positionOf(ivec2(0));
  float spacing = dot(across.xy, across.xy) / float(ROWS * COLS);
  for (int t = 0; t < ROWS; t++) for (int s = 0; s < COLS; s++) {
    ivec2 view = ivec2(s, t);
    vec3 position = positionOf(view * STEP), apart = position - viewpoint;
    vec2 pixel = moved(here(), viewpoint, position, q);
    if (!inside(pixel)) continue;
    vec2 depth = depthAt(view, pixel), at = inDense(view * STEP, pixel);
    float trust = abs(depth.x - q) <= TOLERANCE ? (depth.y > 0.5 ? 1.0 : UNMEASURED) : CONTRADICTING;
    float near = dot(apart, apart) / spacing + NEAREST;
    total += vec4(texture(views, at).rgb, 1.0) * texture(valid, at).r * trust / (near * near);
  }
  colour = vec4(total.a > 0.0 ? total.rgb / total.a : UNSEEN, 1.0);
}`;

  const picture = async (source) => {
    const image = new Image();
    image.src = source;
    await image.decode();
    return image;
  };

  const texture = (gl, image, unit, filter) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  };

  // A buffer for q of each pixel, and the texture that holds it.
  const surfaceBuffer = (gl, width, height, unit) => {
    texture(gl, new ImageData(width, height), unit, gl.NEAREST);
    const buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    const held = gl.getParameter(gl.TEXTURE_BINDING_2D);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, held, 0);
    return buffer;
  };

  const program = (gl, fragment) => {
    const linked = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(linked, shader);
    }
    gl.linkProgram(linked);
    if (!gl.getProgramParameter(linked, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(linked));
    return linked;
  };

  // Renders into any number of 2-D canvases by one hidden WebGL canvas, which holds the pictures once.
  Studio.LightField = class {
    static async load(about) {
      const names = ["views_jpg", "valid_png", "depths_png"];
      const [views, valid, depths] = await Promise.all(names.map((name) => picture(about[name])));
      return new Studio.LightField(about, views, valid, depths);
    }

    constructor(about, views, valid, depths) {
      Object.assign(this, { about, views, depths });
      const [width, height] = about.size_px;
      this.canvas = Studio.element("canvas", { width, height });
      const gl = this.canvas.getContext("webgl2", { antialias: false });
      this.gl = gl;
      this.levels = this.centralLevels();
      if (!gl) return;
      texture(gl, views, 0, gl.LINEAR);
      texture(gl, valid, 1, gl.NEAREST);
      texture(gl, depths, 2, gl.NEAREST);
      this.surfaces = surfaceBuffer(gl, width, height, 3);
      const sources = { refocus: REFOCUS, surface: SURFACE, colour: COLOUR };
      this.programs = Object.fromEntries(
        Object.entries(sources).map(([name, source]) => [name, program(gl, shared(about) + source)]),
      );
      for (const linked of Object.values(this.programs)) {
        gl.useProgram(linked);
        ["views", "valid", "depths", "surfaces"].forEach((name, unit) => gl.uniform1i(gl.getUniformLocation(linked, name), unit));
        gl.uniform3fv(gl.getUniformLocation(linked, "positions"), about.positions_mm.flat(2));
      }
    }

    // Inverse distance of each pixel of the reference view, as stored: 0 is the farthest, 255 the nearest.
    centralLevels() {
      const { size_px: [width, height], reference: [t, s] } = this.about;
      const drawing = Studio.element("canvas", { width, height }).getContext("2d", { willReadFrequently: true });
      drawing.drawImage(this.depths, s * width, t * height, width, height, 0, 0, width, height);
      return drawing.getImageData(0, 0, width, height).data.filter((_, i) => i % 4 === 0);
    }

    inverse(level) {
      const [far, near] = this.about.inverse_mm;
      return far + (level / 255) * (near - far);
    }

    depthMm(inverse) {
      return 1 / inverse + this.about.pupil_offset_mm;
    }

    drawView(drawing, [t, s], [left, top, width, height]) {
      const [tileWidth, tileHeight] = this.about.size_px;
      const column = s * this.about.step * tileWidth;
      const row = t * this.about.step * tileHeight;
      drawing.drawImage(this.views, column, row, tileWidth, tileHeight, left, top, width, height);
    }

    // Draw the picture focused at an inverse distance from the reference view.
    refocus(drawing, inverse) {
      this.run("refocus", null, (gl, place) => gl.uniform1f(place("q"), inverse));
      this.show(drawing);
    }

    // Draw the picture of a pinhole at a position (x, y) in the plane of the views, mm.
    viewFrom(drawing, [x, y]) {
      const { positions_mm: positions, grid: [rows, cols], step, reference } = this.about;
      const before = (count, value, at) => {
        let index = 0;
        while (index < count - 2 && value > at((index + 1) * step)) index++;
        return index;
      };
      const [t, s] = reference.map((index) => index * step);
      const cell = [before(cols, x, (k) => positions[t][k][0]), before(rows, y, (k) => positions[k][s][1])];
      this.run("surface", this.surfaces, (gl, place) => {
        gl.uniform3f(place("viewpoint"), x, y, 0);
        gl.uniform2i(place("cell"), ...cell);
      });
      this.run("colour", null, (gl, place) => gl.uniform3f(place("viewpoint"), x, y, 0));
      this.show(drawing);
    }

    run(name, buffer, set) {
      const { gl } = this;
      if (!gl) return;
      gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
      gl.useProgram(this.programs[name]);
      set(gl, (uniform) => gl.getUniformLocation(this.programs[name], uniform));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }

    show(drawing) {
      if (this.gl) drawing.drawImage(this.canvas, 0, 0);
      else this.drawView(drawing, this.about.reference, [0, 0, this.canvas.width, this.canvas.height]);
    }
  };
})();
