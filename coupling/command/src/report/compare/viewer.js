// The thigh in three dimensions with WebGL 2. Nothing is fetched: surfaces, places and fields are in the page.
(() => {
  "use strict";
  const id = (name) => document.getElementById(name);
  const [canvas, note, tip] = ["thigh", "viewer-note", "tip"].map(id);
  if (!canvas) return;
  const head = JSON.parse(id("thigh-head").textContent);
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) {
    note.textContent = "This browser offers no WebGL 2; the figures below need none.";
    return;
  }

  // ---- data ----
  const unpack = (name) => Uint8Array.from(atob(id("thigh-" + name).textContent), (c) => c.charCodeAt(0)).buffer;
  const MISSING = -1e9;
  const faces = new Uint32Array(unpack("faces"));
  const triangles = [];
  const edges = [];
  for (const part of head.parts) {
    part.first = triangles.length;
    part.firstEdge = edges.length;
    part.shown = true;
    const seen = new Set();
    for (let f = part.faces[0]; f < part.faces[1]; f++) {
      const [a, b, c, d] = faces.subarray(4 * f, 4 * f + 4);
      triangles.push(a, b, c);
      if (c !== d) triangles.push(a, c, d);
      for (const [p, q] of c === d ? [[a, b], [b, c], [c, a]] : [[a, b], [b, c], [c, d], [d, a]]) {
        const key = Math.min(p, q) * head.vertices + Math.max(p, q);
        if (!seen.has(key)) edges.push(p, q);
        seen.add(key);
      }
    }
    part.count = triangles.length - part.first;
    part.edgeCount = edges.length - part.firstEdge;
    part.colour = part.bone ? channels(head.colours.bone).map((c) => c / 255) : hsl(part.hue / 360, 0.5, 0.6);
  }
  const paint = new Float32Array(3 * head.vertices);
  for (const part of head.parts) for (let i = part.vertices[0]; i < part.vertices[1]; i++) paint.set(part.colour, 3 * i);

  /** Places, normals and fields of a frame; unpacked when first shown. */
  function frameData(frame) {
    if (frame.places) return frame;
    const packed = new Uint16Array(unpack(head.frames.indexOf(frame)));
    const n = head.vertices;
    const [low, high] = head.box;
    frame.places = new Float32Array(3 * n);
    for (let i = 0; i < 3 * n; i++) {
      const c = i % 3;
      frame.places[i] = low[c] + (packed[i] / 65534) * (high[c] - low[c]);
    }
    frame.fields = {};
    let at = 3 * n;
    head.fields.forEach((field, f) => {
      if (!frame.has[f]) return;
      const values = new Float32Array(n);
      const [least, most] = field.range;
      for (let i = 0; i < n; i++, at++) {
        values[i] = packed[at] === 65535 ? MISSING : least + (packed[at] / 65534) * (most - least);
      }
      frame.fields[field.key] = values;
    });
    const normals = (frame.normals = new Float32Array(3 * n));
    const x = frame.places;
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
      const u = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]];
      const v = [x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]];
      const w = cross(u, v);
      for (const p of [a, b, c]) for (let k = 0; k < 3; k++) normals[p + k] += w[k];
    }
    return frame;
  }

  function cross(u, v) {
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  }
  function hsl(h, s, l) {
    const part = (n) => {
      const k = (n + h * 12) % 12;
      return l - s * Math.min(l, 1 - l) * Math.max(-1, Math.min(k - 3, 9 - k, 1));
    };
    return [part(0), part(8), part(4)];
  }

  // ---- colours ----
  const { rising: RISING, diverging: DIVERGING } = head.colours;
  function channels(hex) {
    return [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
  }
  const ramp = (stops) => {
    const out = new Uint8Array(256 * 4);
    for (let i = 0; i < 256; i++) {
      const at = (i / 255) * (stops.length - 1);
      const k = Math.min(Math.floor(at), stops.length - 2);
      const [p, q] = [channels(stops[k]), channels(stops[k + 1])];
      for (let c = 0; c < 3; c++) out[4 * i + c] = Math.round(p[c] + (at - k) * (q[c] - p[c]));
      out[4 * i + 3] = 255;
    }
    return out;
  };

  // ---- drawing ----
  const VERTEX = `#version 300 es
    in vec3 place; in vec3 normal; in float value; in vec3 paint;
    uniform mat4 view, projection; uniform vec4 cut;
    out vec3 turned; out vec3 seen; out vec3 base; out float shade; out float before;
    void main() {
      vec4 eye = view * vec4(place, 1.0);
      turned = mat3(view) * normal;
      seen = eye.xyz;
      shade = value;
      base = paint;
      before = dot(cut.xyz, place) - cut.w;
      gl_Position = projection * eye;
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 turned; in vec3 seen; in vec3 base; in float shade; in float before;
    uniform bool byValue, lines, diverging; uniform vec2 shown; uniform vec3 missing; uniform sampler2D map;
    uniform float through;
    out vec4 painted;
    void main() {
      if (before > 0.0) discard;
      if (lines) { painted = vec4(0.05, 0.06, 0.08, 0.34 * (1.0 - 0.8 * through)); return; }
      vec3 n = normalize(turned);
      vec3 own = base;
      float weight = 0.0;
      if (byValue) {
        float t = clamp((shade - shown.x) / (shown.y - shown.x), 0.0, 1.0);
        bool none = shade < -1e8;
        own = none ? missing : texture(map, vec2(t * 255.0 / 256.0 + 0.5 / 256.0, 0.5)).rgb;
        weight = none ? 0.0 : diverging ? abs(2.0 * t - 1.0) : t;
      }
      // What carries little becomes glass first.
      float alpha = 1.0 - through * (1.0 - 0.9 * smoothstep(0.0, 0.7, weight));
      if (!gl_FrontFacing) {
        n = -n;
        // Where a cut looks into a closed surface, its inside in one flat colour is the face of the cut.
        if (!byValue && through == 0.0) { painted = vec4(own * 0.82, 1.0); return; }
      }
      vec3 light = normalize(vec3(-0.35, 0.55, 0.8));
      float lit = max(dot(n, light), 0.0);
      float gloss = pow(max(dot(n, normalize(light - normalize(seen))), 0.0), 32.0);
      painted = vec4(own * (0.50 + 0.14 * n.y + 0.50 * lit) + 0.08 * gloss, alpha);
    }`;
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    note.textContent = "The drawing program does not run here: " + gl.getProgramInfoLog(program);
    return;
  }
  gl.useProgram(program);
  const uniform = (name) => gl.getUniformLocation(program, name);
  const u = Object.fromEntries(["view", "projection", "byValue", "lines", "diverging", "shown", "missing", "map", "cut", "through"].map((n) => [n, uniform(n)]));
  const attribute = (name, size) => {
    const buffer = gl.createBuffer();
    const at = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, gl.FLOAT, false, 0, 0);
    return (values) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    };
  };
  const buffers = { place: attribute("place", 3), normal: attribute("normal", 3), value: attribute("value", 1) };
  attribute("paint", 3)(paint);
  gl.uniform3fv(u.missing, channels(head.colours.missing).map((c) => c / 255));
  const indices = (list) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(list), gl.STATIC_DRAW);
    return buffer;
  };
  const [triangleBuffer, edgeBuffer] = [indices(triangles), indices(edges)];
  const sortedBuffer = gl.createBuffer();

  /** Triangles of the muscles that are shown, far ones first: glass is painted from behind. A counting sort of 16-bit depths. */
  function farFirst(eye) {
    const x = state.frame.places;
    const shown = head.parts.filter((p) => !p.bone && p.shown);
    const total = shown.reduce((sum, p) => sum + p.count / 3, 0);
    const depth = new Float32Array(total);
    let [at, low, high] = [0, Infinity, -Infinity];
    for (const part of shown) {
      for (let t = part.first; t < part.first + part.count; t += 3) {
        let d = 0;
        for (let k = 0; k < 3; k++) {
          const p = 3 * triangles[t + k];
          d += eye[0] * x[p] + eye[1] * x[p + 1] + eye[2] * x[p + 2];
        }
        depth[at++] = d;
        low = Math.min(low, d);
        high = Math.max(high, d);
      }
    }
    const scale = high > low ? 65535 / (high - low) : 0;
    const starts = new Uint32Array(65537);
    for (const d of depth) starts[1 + ((d - low) * scale | 0)]++;
    for (let k = 0; k < 65536; k++) starts[k + 1] += starts[k];
    const order = new Uint32Array(3 * total);
    at = 0;
    for (const part of shown) {
      for (let t = part.first; t < part.first + part.count; t += 3, at++) {
        const place = 3 * starts[(depth[at] - low) * scale | 0]++;
        for (let k = 0; k < 3; k++) order[place + k] = triangles[t + k];
      }
    }
    return order;
  }
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.LINEAR);
  for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
  gl.enable(gl.DEPTH_TEST);
  gl.enable(gl.POLYGON_OFFSET_FILL);
  gl.polygonOffset(1, 1);
  gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

  const muscles = head.parts.filter((p) => !p.bone);
  const HALF_ANGLE = (11 * Math.PI) / 180;
  const rest = frameData(head.frames[0]).places;
  const extent = [0, 1, 2].map((c) => {
    let [low, high] = [Infinity, -Infinity];
    for (const part of head.parts.filter((p) => !p.bone)) {
      for (let i = part.vertices[0]; i < part.vertices[1]; i++) {
        low = Math.min(low, rest[3 * i + c]);
        high = Math.max(high, rest[3 * i + c]);
      }
    }
    return [low, high];
  });
  const size = Math.hypot(...extent.map(([low, high]) => high - low));
  const camera = {};
  /** Looks from the front and the outside at all muscles. */
  function home() {
    camera.target = extent.map(([low, high]) => (low + high) / 2);
    [camera.yaw, camera.pitch, camera.distance] = [0.62, 0.08, (0.53 * size) / Math.tan(HALF_ANGLE)];
  }
  home();
  /** Unit vectors to the right, up and towards the eye. X points forward, Y up, Z to the right of the body. */
  function axes() {
    const { yaw, pitch } = camera;
    const eye = [Math.cos(pitch) * Math.cos(yaw), Math.sin(pitch), Math.cos(pitch) * Math.sin(yaw)];
    const right = [Math.sin(yaw), 0, -Math.cos(yaw)];
    return [right, cross(eye, right), eye];
  }
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  const state = { configuration: 0, field: "", frame: null, bones: true, mesh: false, through: 0, cut: "", cutAt: 0.5 };
  /** From where to where the muscles of the frame go along an axis [m]. */
  function reach(axis) {
    const frame = state.frame;
    frame.reach ??= [0, 1, 2].map((c) => {
      let [low, high] = [Infinity, -Infinity];
      for (const part of muscles) {
        for (let i = part.vertices[0]; i < part.vertices[1]; i++) {
          low = Math.min(low, frame.places[3 * i + c]);
          high = Math.max(high, frame.places[3 * i + c]);
        }
      }
      return [low, high];
    });
    return frame.reach[axis];
  }
  /** The plane before which everything is taken away: its axis, and where it is along it [m]. */
  function plane() {
    if (state.cut === "") return null;
    const axis = Number(state.cut);
    const [low, high] = reach(axis);
    return { axis, at: low + state.cutAt * (high - low) };
  }
  function draw() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map((s) => Math.max(1, Math.round(s * ratio)));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    gl.viewport(0, 0, w, h);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [right, up, eye] = axes();
    const shift = [right, up, eye].map((a) => -dot(a, camera.target));
    gl.uniformMatrix4fv(u.view, false, [
      right[0], up[0], eye[0], 0, right[1], up[1], eye[1], 0, right[2], up[2], eye[2], 0,
      shift[0], shift[1], shift[2] - camera.distance, 1,
    ]);
    const [near, far] = [Math.max(0.01, camera.distance - 2 * size), camera.distance + 2 * size];
    const f = 1 / Math.tan(HALF_ANGLE);
    gl.uniformMatrix4fv(u.projection, false, [
      (f * h) / w, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0,
    ]);
    const field = head.fields.find((x) => x.key === state.field);
    if (field) {
      gl.uniform2fv(u.shown, field.shown);
      gl.uniform1i(u.diverging, field.diverging ? 1 : 0);
    }
    const cut = plane();
    gl.uniform4fv(u.cut, cut ? [0, 1, 2].map((c) => (c === cut.axis ? 1 : 0)).concat(cut.at) : [0, 0, 0, 1]);
    gl.uniform1i(u.lines, 0);
    const shown = head.parts.filter((p) => (p.bone ? state.bones : p.shown));
    const solid = (parts) => {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, triangleBuffer);
      for (const part of parts) {
        gl.uniform1i(u.byValue, field && !part.bone ? 1 : 0);
        gl.drawElements(gl.TRIANGLES, part.count, gl.UNSIGNED_INT, 4 * part.first);
      }
    };
    gl.uniform1f(u.through, 0);
    solid(state.through > 0 ? shown.filter((p) => p.bone) : shown);
    gl.uniform1f(u.through, state.through);
    gl.enable(gl.BLEND);
    if (state.through > 0) {
      const order = farFirst(eye);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, sortedBuffer);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, order, gl.DYNAMIC_DRAW);
      gl.depthMask(false);
      gl.uniform1i(u.byValue, field ? 1 : 0);
      gl.drawElements(gl.TRIANGLES, order.length, gl.UNSIGNED_INT, 0);
      gl.depthMask(true);
    }
    if (state.mesh) {
      gl.uniform1i(u.lines, 1);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, edgeBuffer);
      for (const part of shown.filter((p) => !p.bone)) gl.drawElements(gl.LINES, part.edgeCount, gl.UNSIGNED_INT, 4 * part.firstEdge);
    }
    gl.disable(gl.BLEND);
    drawTriad(right, up, eye);
    drawScale();
  }

  const TRIAD = [["front", "#c0392b"], ["up", "#1e8449"], ["right", "#2471a3"]];
  /** Where the axes of the body point; what points towards the eye is drawn last. */
  function drawTriad(right, up, eye) {
    const order = [0, 1, 2].sort((a, b) => eye[a] - eye[b]);
    id("triad").innerHTML = order
      .map((axis) => {
        const [x, y] = [32 * right[axis], -32 * up[axis]].map((v) => Number(v.toFixed(1)));
        const [name, colour] = TRIAD[axis];
        return `<path d="M0 0L${x} ${y}" stroke="${colour}" stroke-width="3" stroke-linecap="round" fill="none"/>` +
          `<text class="mid" x="${(1.28 * x).toFixed(1)}" y="${(1.28 * y + 3.5).toFixed(1)}" style="fill:${colour}">${name}</text>`;
      })
      .join("");
  }
  /** A length of 1, 2 or 5 times a power of ten, as long as it is at the centre of the turn. */
  function drawScale() {
    const perPixel = (2 * camera.distance * Math.tan(HALF_ANGLE)) / Math.max(canvas.clientHeight, 1);
    const most = 110 * perPixel;
    const power = 10 ** Math.floor(Math.log10(most));
    const length = power * [5, 2, 1].find((n) => n * power <= most);
    const [label, line] = id("scalebar").children;
    label.textContent = length < 0.995 ? `${Number((1e3 * length).toPrecision(1))} mm` : `${length} m`;
    line.style.width = length / perPixel + "px";
  }

  // ---- choices ----
  const slider = id("pick-step");
  const frames = () => head.frames.filter((f) => f.configuration === state.configuration);
  const digits = (v, range) => v.toFixed(Math.max(0, 2 - Math.floor(Math.log10(Math.max(range, 1e-9))))).replace("-", "−");
  function press(group, value) {
    for (const button of id(group).children) button.setAttribute("aria-pressed", button.dataset.value === value);
  }
  /** Brings the chosen frame and field to the graphics card and says what is shown. */
  function update() {
    const list = frames();
    slider.max = list.length - 1;
    const frame = (state.frame = frameData(list[Math.min(slider.value, list.length - 1)]));
    buffers.place(frame.places);
    buffers.normal(frame.normals);
    const field = head.fields.find((x) => x.key === state.field);
    const values = field && frame.fields[field.key];
    buffers.value(values || new Float32Array(head.vertices).fill(MISSING));
    id("step-name").textContent = frame.label;
    press("pick-configuration", String(state.configuration));
    press("pick-field", state.field);
    press("pick-cut", state.cut);
    id("cut-at").disabled = state.cut === "";
    nameCut();
    note.textContent = !field ? "" : values ? field.about : `${field.label}: no values in this frame`;
    const bar = id("colourbar");
    bar.hidden = !field;
    if (field) {
      const stops = field.diverging ? DIVERGING : RISING;
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, ramp(stops));
      const [low, high] = field.shown;
      bar.children[0].textContent = field.label + (field.unit ? ", " + field.unit : "");
      bar.children[1].style.background = `linear-gradient(90deg, ${stops.join(", ")})`;
      bar.children[2].replaceChildren(
        ...[0, 0.25, 0.5, 0.75, 1].map((t) => {
          const mark = document.createElement("span");
          const more = t === 1 && field.range[1] > high ? "≥ " : t === 0 && field.range[0] < low ? "≤ " : "";
          mark.textContent = more + digits(low + t * (high - low), high - low);
          return mark;
        }),
      );
    }
    draw();
  }
  id("pick-configuration").addEventListener("click", (event) => {
    if (event.target.dataset.value === undefined || event.target.disabled) return;
    state.configuration = Number(event.target.dataset.value);
    update();
  });
  id("pick-field").addEventListener("click", (event) => {
    if (event.target.dataset.value === undefined) return;
    state.field = event.target.dataset.value;
    update();
  });
  slider.addEventListener("input", update);
  /** Says where the cut is. */
  function nameCut() {
    const cut = plane();
    id("cut-name").textContent = cut ? `${"xyz"[cut.axis]} = ${(1e3 * cut.at).toFixed(0).replace("-", "−")} mm` : "";
  }
  id("pick-cut").addEventListener("click", (event) => {
    if (event.target.dataset.value === undefined) return;
    state.cut = event.target.dataset.value;
    update();
  });
  id("cut-at").addEventListener("input", (event) => {
    state.cutAt = 1 - event.target.value / 100;
    nameCut();
    draw();
  });
  id("see-through").addEventListener("input", (event) => {
    state.through = event.target.value / 100;
    draw();
  });
  for (const [name, key] of [["show-bones", "bones"], ["show-mesh", "mesh"]]) {
    id(name).addEventListener("change", (event) => {
      state[key] = event.target.checked;
      draw();
    });
  }
  const list = id("muscle-list");
  const mark = () => muscles.forEach((p, i) => list.children[i].setAttribute("aria-pressed", p.shown));
  for (const part of muscles) {
    const button = document.createElement("button");
    button.type = "button";
    button.title = "click: show or hide; double click: alone, or all again";
    const key = document.createElement("i");
    key.style.background = `rgb(${part.colour.map((c) => Math.round(255 * c)).join(" ")})`;
    button.append(key, part.name);
    button.addEventListener("click", () => {
      part.shown = !part.shown;
      mark();
      draw();
    });
    button.addEventListener("dblclick", () => {
      const alone = muscles.every((p) => p === part || !p.shown);
      for (const p of muscles) p.shown = alone || p === part;
      mark();
      draw();
    });
    list.append(button);
  }
  const every = document.createElement("button");
  every.type = "button";
  every.textContent = "all";
  every.addEventListener("click", () => {
    for (const p of muscles) p.shown = true;
    mark();
    draw();
  });
  list.append(every);
  mark();

  // ---- pointer ----
  const pointers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    tip.hidden = true;
    event.preventDefault();
    canvas.focus({ preventScroll: true });
  });
  window.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) {
      if (event.target === canvas) name(event);
      return;
    }
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (pointers.size === 2) {
      const [other] = [...pointers].filter(([key]) => key !== event.pointerId).map((p) => p[1]);
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      camera.distance *= apart(before) / Math.max(apart(now), 1);
    } else if (event.shiftKey || event.buttons === 2) {
      const [right, up] = axes();
      const scale = (2 * camera.distance * Math.tan(HALF_ANGLE)) / canvas.clientHeight;
      camera.target = camera.target.map((t, c) => t - scale * (dx * right[c] - dy * up[c]));
    } else {
      camera.yaw += 0.008 * dx;
      camera.pitch = Math.max(-1.55, Math.min(1.55, camera.pitch + 0.008 * dy));
    }
    pointers.set(event.pointerId, now);
    draw();
  });
  for (const kind of ["pointerup", "pointercancel"]) window.addEventListener(kind, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(0.0012 * event.deltaY));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => {
    home();
    draw();
  });
  canvas.addEventListener("keydown", (event) => {
    if (event.shiftKey && event.key.startsWith("Arrow")) {
      const [right, up] = axes();
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      camera.target = camera.target.map((t, c) => t - 0.02 * size * (way[0] * right[c] + way[1] * up[c]));
      event.preventDefault();
      return draw();
    }
    if (event.key === "Home") {
      event.preventDefault();
      home();
      return draw();
    }
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (turn) {
      camera.yaw += turn[0];
      camera.pitch = Math.max(-1.55, Math.min(1.55, camera.pitch + turn[1]));
      event.preventDefault();
      draw();
    } else if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 0.9 : 1.1);
  });
  function zoom(factor) {
    camera.distance = Math.max(0.1 * size, Math.min(20 * size, camera.distance * factor));
    draw();
  }

  /** What is under the pointer: the nearest triangle along the line of sight. */
  function pick(event) {
    const box = canvas.getBoundingClientRect();
    const [right, up, eye] = axes();
    const tan = Math.tan(HALF_ANGLE);
    const sx = ((2 * (event.clientX - box.left)) / box.width - 1) * tan * (box.width / box.height);
    const sy = (1 - (2 * (event.clientY - box.top)) / box.height) * tan;
    const from = [0, 1, 2].map((c) => camera.target[c] + camera.distance * eye[c]);
    const ray = [0, 1, 2].map((c) => sx * right[c] + sy * up[c] - eye[c]);
    const x = state.frame.places;
    const cut = plane();
    let best = null;
    for (const part of head.parts) {
      if (part.bone ? !state.bones : !part.shown) continue;
      for (let t = part.first; t < part.first + part.count; t += 3) {
        const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
        const e1 = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]];
        const e2 = [x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]];
        const p = cross(ray, e2);
        const det = dot(e1, p);
        if (Math.abs(det) < 1e-14) continue;
        const s = [from[0] - x[a], from[1] - x[a + 1], from[2] - x[a + 2]];
        const v = dot(s, p) / det;
        const q = cross(s, e1);
        const w = dot(ray, q) / det;
        const along = dot(e2, q) / det;
        if (v < 0 || w < 0 || v + w > 1 || along < 0 || (best && along > best.along)) continue;
        if (cut && from[cut.axis] + along * ray[cut.axis] > cut.at) continue;
        best = { part, along, corners: [triangles[t], triangles[t + 1], triangles[t + 2]], weights: [1 - v - w, v, w] };
      }
    }
    return best;
  }
  function name(event) {
    const found = pick(event);
    tip.hidden = !found;
    if (!found) return;
    const field = head.fields.find((x) => x.key === state.field);
    const values = field && state.frame.fields[field.key];
    const corners = values && found.corners.map((n) => values[n]);
    const strong = document.createElement("b");
    if (corners && corners.every((v) => v !== MISSING)) {
      const value = dot(corners, found.weights);
      strong.textContent = digits(value, field.shown[1] - field.shown[0]) + " " + field.unit;
    }
    tip.replaceChildren(found.part.name, strong);
    const box = tip.getBoundingClientRect();
    tip.style.left = Math.max(4, Math.min(event.clientX + 16, innerWidth - box.width - 4)) + "px";
    tip.style.top = Math.max(4, Math.min(event.clientY + 12, innerHeight - box.height - 4)) + "px";
  }
  canvas.addEventListener("pointerleave", () => (tip.hidden = true));

  // ---- start: the last step of the richest configuration ----
  state.configuration = Math.max(...head.frames.map((f) => f.configuration));
  slider.max = frames().length - 1;
  slider.value = slider.max;
  update();
  new ResizeObserver(draw).observe(canvas);
})();
