// The 3D view of a map's report: draws the layers of the page's data, and turns them by mouse,
// touch and keys. Metres, z up, as in the map's world.
(() => {
  "use strict";
  const figure = document.getElementById("view");
  const canvas = figure.querySelector("canvas");
  const data = JSON.parse(document.getElementById("view-data").textContent);
  if (!document.createElement("canvas").getContext("webgl2")) return; // the sentence stays

  // ---- data -------------------------------------------------------------------------------------

  const decoded = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const bytes = (array) => (typeof array === "string" ? decoded(array) : array);
  const floats = (text) => new Float32Array(bytes(text));
  const point = (values, n) => values.subarray(3 * n, 3 * n + 3);

  /** Ends of the pieces between neighbours of a line, where both are known. */
  function pieces(line) {
    const ends = [];
    for (let n = 0; n + 1 < line.length / 3; n++) {
      const both = line.subarray(3 * n, 3 * n + 6);
      if (!both.some(Number.isNaN)) ends.push(...both);
    }
    return ends;
  }

  /** Edges of pyramids: the camera, then the corners of its image, clockwise. */
  function frusta(points) {
    const ends = [];
    for (let first = 0; first < points.length / 3; first += 5)
      for (const [a, b] of [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]])
        ends.push(...point(points, first + a), ...point(points, first + b));
    return ends;
  }

  /** Lines of the floor, a square a step. */
  function squares(low, high, step) {
    const [left, bottom] = [0, 1].map((k) => Math.floor(low[k] / step));
    const [right, top] = [0, 1].map((k) => Math.ceil(high[k] / step));
    const ends = [];
    for (let x = left; x <= right; x++) ends.push(x, bottom, 0, x, top, 0);
    for (let y = bottom; y <= top; y++) ends.push(left, y, 0, right, y, 0);
    return ends.map((value) => value * step);
  }

  // ---- layers -----------------------------------------------------------------------------------

  const renderer = new ogl.Renderer({ canvas, antialias: true, dpr: Math.min(devicePixelRatio, 2) });
  const gl = renderer.gl;
  const scene = new ogl.Transform();
  const camera = new ogl.Camera(gl, { fov: 45 });
  const shared = { size: { value: [1, 1] }, cut: { value: 0 } };
  camera.up.set(0, 0, 1);

  const POINT_VERTEX = `
    attribute vec3 position, color;
    uniform mat4 modelViewMatrix, projectionMatrix;
    uniform vec3 low, span;
    uniform vec2 size;
    uniform float spacing, cut;
    varying vec3 seen;
    void main() {
      vec3 world = low + position * span;
      gl_Position = projectionMatrix * modelViewMatrix * vec4(world, 1.0);
      gl_PointSize = clamp(spacing * projectionMatrix[1][1] * size.y / 2.0 / gl_Position.w, 1.5, 40.0);
      if (world.z > cut) gl_Position = vec4(2.0, 2.0, 2.0, 1.0); // outside of the picture
      seen = color;
    }`;
  const POINT_FRAGMENT = `
    precision mediump float;
    varying vec3 seen;
    void main() { gl_FragColor = vec4(seen, 1.0); }`;
  const MESH_VERTEX = `
    attribute vec3 position, color;
    uniform mat4 modelViewMatrix, projectionMatrix;
    uniform vec3 low, span;
    varying vec3 seen;
    varying float height;
    void main() {
      vec3 world = low + position * span;
      gl_Position = projectionMatrix * modelViewMatrix * vec4(world, 1.0);
      seen = color;
      height = world.z;
    }`;
  const MESH_FRAGMENT = `
    precision highp float;
    uniform float cut;
    varying vec3 seen;
    varying float height;
    void main() {
      if (height > cut) discard;
      gl_FragColor = vec4(seen, 1.0);
    }`;
  const LINE_VERTEX = `
    attribute vec2 corner; // along the line from 0 to 1, across it from -1 to 1
    attribute vec3 a, b;
    uniform mat4 modelViewMatrix, projectionMatrix;
    uniform vec2 size;
    uniform float width, near;
    void main() {
      vec4 p = projectionMatrix * modelViewMatrix * vec4(a, 1.0);
      vec4 q = projectionMatrix * modelViewMatrix * vec4(b, 1.0);
      if (p.w < near) p = mix(p, q, (near - p.w) / (q.w - p.w));
      if (q.w < near) q = mix(q, p, (near - q.w) / (p.w - q.w));
      vec2 along = (q.xy / q.w - p.xy / p.w) * size;
      along = length(along) > 1e-4 ? normalize(along) : vec2(1.0, 0.0);
      gl_Position = corner.x < 0.5 ? p : q;
      gl_Position.xy += vec2(-along.y, along.x) * corner.y * width / size * gl_Position.w;
    }`;
  const LINE_FRAGMENT = `
    precision mediump float;
    uniform vec4 paint;
    void main() { gl_FragColor = paint; }`;

  /** Coloured points, as steps of their box. */
  const colored = ({ positions, colors }) => ({
    position: { size: 3, data: new Uint16Array(bytes(positions)), normalized: true },
    color: { size: 3, data: new Uint8Array(bytes(colors)), type: gl.UNSIGNED_BYTE, normalized: true },
  });

  const AT_ONCE = 300_000; // points that a first motion draws
  let share = 1; // of the cloud that is drawn while the picture moves, as much as is drawn in time
  let thin = () => {}; // draws a share of the cloud, in larger points

  function addCloud({ low, span, spacing_m, ...points }, parent) {
    const geometry = new ogl.Geometry(gl, colored(points));
    const count = geometry.attributes.position.count;
    const uniforms = { ...shared, low: { value: low }, span: { value: span }, spacing: { value: spacing_m } };
    const program = new ogl.Program(gl, { vertex: POINT_VERTEX, fragment: POINT_FRAGMENT, uniforms });
    new ogl.Mesh(gl, { mode: gl.POINTS, geometry, program, frustumCulled: false }).setParent(parent);
    share = Math.min(AT_ONCE / count, 1);
    thin = (drawn) => {
      geometry.setDrawRange(0, Math.ceil(count * drawn));
      uniforms.spacing.value = spacing_m / Math.sqrt(drawn);
    };
  }

  /** A surface, which is seen from its front only: one looks into rooms from outside. */
  function addMesh({ low, span, triangles, ...points }, parent) {
    const geometry = new ogl.Geometry(gl, colored(points));
    const Numbers = geometry.attributes.position.count > 65536 ? Uint32Array : Uint16Array;
    geometry.addAttribute("index", { data: new Numbers(bytes(triangles)) });
    const uniforms = { ...shared, low: { value: low }, span: { value: span } };
    const program = new ogl.Program(gl, { vertex: MESH_VERTEX, fragment: MESH_FRAGMENT, uniforms });
    new ogl.Mesh(gl, { geometry, program, frustumCulled: false }).setParent(parent);
  }

  /** Lines (ends, two points a line): full where they are seen, faint behind what hides them. */
  function addLines(ends, color, width, parent, behind = 0.3) {
    const data = new Float32Array(ends);
    if (!data.length) return;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    const end = { size: 3, type: gl.FLOAT, buffer, stride: 24, count: data.length / 6, instanced: 1 };
    const geometry = new ogl.Geometry(gl, {
      corner: { size: 2, data: new Float32Array([0, -1, 1, -1, 0, 1, 1, 1]) },
      a: { ...end },
      b: { ...end, offset: 12 },
    });
    const paint = [1, 3, 5].map((k) => parseInt(color.slice(k, k + 2), 16) / 255);
    for (const [alpha, depthTest] of behind ? [[1, true], [behind, false]] : [[1, true]]) {
      const uniforms = { ...shared, near: { value: 0.02 }, width: { value: width * renderer.dpr } };
      uniforms.paint = { value: [...paint, alpha] };
      const program = new ogl.Program(gl, {
        vertex: LINE_VERTEX, fragment: LINE_FRAGMENT, uniforms, cullFace: false,
        transparent: !depthTest, depthTest, depthWrite: depthTest,
      });
      const mesh = new ogl.Mesh(gl, { mode: gl.TRIANGLE_STRIP, geometry, program, frustumCulled: false });
      mesh.setParent(parent);
    }
  }

  const DRAW = {
    cloud: addCloud,
    mesh: addMesh,
    lines: ({ lines, color }, parent) => addLines(lines.flatMap((l) => pieces(floats(l))), color, 2, parent),
    pairs: ({ pairs, color }, parent) => addLines(floats(pairs), color, 1, parent, 0.12),
    frusta: ({ points, color, width }, parent) => addLines(frusta(floats(points)), color, width, parent),
    squares: ({ step_m, color }, parent) => addLines(squares(data.low, data.high, step_m), color, 0.5, parent, 0),
  };

  /** Add a layer when it is first shown; one that is served is fetched then. */
  function addLayer([name, layer]) {
    const parent = new ogl.Transform();
    parent.setParent(scene);
    const box = figure.querySelector(`[data-layer="${name}"]`);
    let isAdded = false;
    async function show() {
      parent.visible = box.checked;
      if (box.checked && !isAdded) {
        isAdded = true;
        const whole = layer.address ? await fetched(layer, box) : layer;
        if (whole) DRAW[layer.kind](whole, parent);
        else isAdded = box.checked = false;
      }
      draw();
    }
    box.addEventListener("change", show);
    show();
  }

  /** A layer that is served; null where it cannot be had, which is said. */
  async function fetched(layer, box) {
    const told = figure.querySelector("[role=alert]");
    box.parentElement.classList.add("loading");
    try {
      return { ...layer, ...(await window.servedLayer(layer.address)) };
    } catch (error) {
      told.textContent = `This layer could not be loaded. ${error.message}`;
      told.hidden = false;
      return null;
    } finally {
      box.parentElement.classList.remove("loading");
    }
  }

  // ---- what is looked at --------------------------------------------------------------------------

  const [low, high] = [data.low, data.high];
  const extent = Math.hypot(...high.map((value, k) => value - low[k]));
  const STEEPEST = Math.PI / 2 - 1e-3;
  const START = { yaw: -2.2, pitch: 0.75, isPlan: false };
  const TOP = { yaw: -Math.PI / 2, pitch: STEEPEST, isPlan: true }; // without perspective
  const eye = { at: [0, 0, 0], away: 1, ...START };

  const HALF = Math.tan(Math.PI / 8); // of the picture's height, a metre before the eye

  /** Right, up and forward of the eye, in the world. */
  function axes() {
    const [c, s, level, rise] = [Math.cos(eye.yaw), Math.sin(eye.yaw), Math.cos(eye.pitch), Math.sin(eye.pitch)];
    return [[-s, c, 0], [-c * rise, -s * rise, level], [-c * level, -s * level, -rise]];
  }

  /** The corners of the map's box in the eye's axes, from what is looked at. */
  function corners() {
    const from = (corner) => eye.at.map((value, k) => ((corner >> k) & 1 ? high[k] : low[k]) - value);
    const along = (axis, ray) => axis.reduce((sum, value, k) => sum + value * ray[k], 0);
    return [...Array(8).keys()].map((corner) => axes().map((axis) => along(axis, from(corner))));
  }

  /** Look at the whole map, from as near as it is seen whole. */
  function reset(turn) {
    Object.assign(eye, turn, { at: high.map((value, k) => (value + low[k]) / 2) });
    for (let round = 0; round < 4; round++) {
      const depth = (z) => (eye.isPlan ? 0 : z);
      const far = ([x, y, z]) => Math.max(Math.abs(y), Math.abs(x) / camera.aspect) / HALF - depth(z);
      eye.away = 1.05 * Math.max(...corners().map(far));
      const slopes = corners().map(([, y, z]) => y / (eye.away + depth(z)));
      const middle = (eye.away * (Math.max(...slopes) + Math.min(...slopes))) / 2;
      eye.at = eye.at.map((value, k) => value + middle * axes()[1][k]);
    }
    draw();
  }

  function turn(yaw, pitch) {
    eye.yaw -= yaw;
    eye.pitch = Math.min(Math.max(eye.pitch + pitch, -STEEPEST), STEEPEST);
    eye.isPlan = eye.isPlan && !pitch;
    moved();
  }

  /** Move what is looked at, by pixels on the screen. */
  function move(right, down) {
    const metres = (2 * HALF * eye.away) / canvas.clientHeight;
    const [x, y] = axes();
    eye.at = eye.at.map((value, k) => value + metres * (down * y[k] - right * x[k]));
    moved();
  }

  function zoom(factor) {
    eye.away = Math.min(Math.max(eye.away * factor, 0.3), 20 * extent);
    moved();
  }

  const REST_MS = 250; // without a motion: then all points are drawn
  const SLOW_MS = 50; // from a motion to its picture
  let isMoving = false;
  let resting = 0;

  function moved() {
    clearTimeout(resting);
    isMoving = true;
    draw();
  }

  function rest() {
    isMoving = false;
    draw();
  }

  let waiting = false;
  function draw() {
    if (waiting) return;
    waiting = true;
    const asked = performance.now();
    requestAnimationFrame(() => {
      waiting = false;
      const took = performance.now() - asked;
      if (isMoving) share = Math.min(Math.max(share * Math.max(Math.min(SLOW_MS / took, 1.1), 0.4), 0.02), 1);
      thin(isMoving ? share : 1);
      const forward = axes()[2];
      camera.position.set(...eye.at.map((value, k) => value - eye.away * forward[k]));
      camera.lookAt(new ogl.Vec3(...eye.at));
      const far = eye.away + 2 * extent;
      const [wide, tall] = [camera.aspect * HALF * eye.away, HALF * eye.away];
      if (!eye.isPlan) camera.perspective({ near: 0.02, far });
      else camera.orthographic({ near: -far, far, left: -wide, right: wide, bottom: -tall, top: tall });
      const back = getComputedStyle(canvas).backgroundColor.match(/[\d.]+/g).slice(0, 3);
      gl.clearColor(...back.map((value) => value / 255), 1);
      renderer.render({ scene, camera });
      clearTimeout(resting);
      if (isMoving) resting = setTimeout(rest, REST_MS);
    });
  }

  // ---- hands --------------------------------------------------------------------------------------

  const held = new Map(); // pointers that are down: where they are
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const name of ["pointerup", "pointercancel"])
    canvas.addEventListener(name, (event) => held.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [right, down] = [now[0] - before[0], now[1] - before[1]];
    const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
    held.set(event.pointerId, now);
    if (other) { // two fingers: each does half of what both do
      const apart = (at) => Math.max(Math.hypot(at[0] - other[0], at[1] - other[1]), 1);
      zoom(apart(before) / apart(now));
      move(right / 2, down / 2);
    } else if (event.buttons !== 1 || event.shiftKey) move(right, down);
    else turn(right * 0.008, down * 0.008);
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas) return; // the page scrolls
    event.preventDefault();
    zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 100) * 0.002));
  }, { passive: false });

  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const ACTIONS = {
    "+": () => zoom(1 / 1.2), "=": () => zoom(1 / 1.2), "-": () => zoom(1.2),
    t: () => reset(TOP), Home: () => reset(START),
  };
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const arrow = ARROWS[event.key];
    if (arrow) (event.shiftKey ? () => move(-40 * arrow[0], -40 * arrow[1]) : () => turn(-0.1 * arrow[0], -0.1 * arrow[1]))();
    else if (ACTIONS[event.key]) ACTIONS[event.key]();
    else return;
    event.preventDefault();
  });

  const BUTTONS = {
    start: ACTIONS.Home, top: ACTIONS.t, nearer: ACTIONS["+"], farther: ACTIONS["-"],
    full: () => document.fullscreenElement ? document.exitFullscreen() : figure.requestFullscreen(),
  };
  for (const button of figure.querySelectorAll("button"))
    button.addEventListener("click", BUTTONS[button.value]);
  if (!figure.requestFullscreen) figure.querySelector("[value=full]").remove(); // as on an iPhone

  const slider = figure.querySelector("[name=cut]");
  const cut = () => {
    shared.cut.value = slider.valueAsNumber >= Number(slider.max) ? 1e9 : slider.valueAsNumber; // or all
    slider.nextElementSibling.textContent = `${slider.valueAsNumber.toFixed(1)} m`;
    draw();
  };
  slider.addEventListener("input", cut);

  // ---- start --------------------------------------------------------------------------------------

  figure.classList.add("runs");
  const fit = () => {
    renderer.setSize(canvas.clientWidth, canvas.clientHeight);
    canvas.removeAttribute("style"); // its size is the style sheet's
    camera.aspect = canvas.clientWidth / canvas.clientHeight;
    shared.size.value = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    draw();
  };
  fit();
  new ResizeObserver(fit).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  canvas.addEventListener("webglcontextlost", () => figure.classList.remove("runs"));
  Object.entries(data.layers).forEach(addLayer);
  cut();
  reset(START);
})();
