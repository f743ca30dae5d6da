#include "camber/render/report_viewer.h"

namespace camber {

const char* const kReportViewer = R"JS(
(function () {
  "use strict";
  var canvas = document.getElementById("view");
  var gl = canvas.getContext("webgl2", {alpha: false, antialias: true, preserveDrawingBuffer: true});
  if (!gl) return;
  var text = atob(document.getElementById("glb").textContent);
  var bytes = new Uint8Array(text.length);
  for (var i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  var head = new DataView(bytes.buffer);
  var jsonLength = head.getUint32(12, true);
  var doc = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + jsonLength)));
  var base = 20 + jsonLength + 8;

  function shader(type, source) {
    var s = gl.createShader(type);
    gl.shaderSource(s, source);
    gl.compileShader(s);
    return s;
  }
  var program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER,
    "#version 300 es\nin vec3 p;in vec4 c;uniform mat4 m;uniform float s;out vec4 v;" +
    "void main(){gl_Position=m*vec4(p,1.);gl_PointSize=s;v=c;}"));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER,
    "#version 300 es\nprecision mediump float;in vec4 v;uniform vec4 f;uniform float h;" +
    "out vec4 o;void main(){vec4 c=h>0.?vec4(.53,0.,.19,1.):v*f;vec3 l=c.rgb;" +
    "o=vec4(mix(12.92*l,1.055*pow(l,vec3(1./2.4))-.055,step(.0031308,l)),c.a);}"));
  gl.bindAttribLocation(program, 0, "p");
  gl.bindAttribLocation(program, 1, "c");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return;
  gl.useProgram(program);
  var at = {m: gl.getUniformLocation(program, "m"), s: gl.getUniformLocation(program, "s"),
            f: gl.getUniformLocation(program, "f"), h: gl.getUniformLocation(program, "h")};
  // What is clicked is found by drawing numbers: of the part, from 1, and of its vertex.
  var picking = gl.createProgram();
  gl.attachShader(picking, shader(gl.VERTEX_SHADER,
    "#version 300 es\nin vec3 p;uniform mat4 m;uniform float s;flat out uint i;" +
    "void main(){gl_Position=m*vec4(p,1.);gl_PointSize=s;i=uint(gl_VertexID);}"));
  gl.attachShader(picking, shader(gl.FRAGMENT_SHADER,
    "#version 300 es\nprecision highp float;precision highp int;flat in uint i;" +
    "uniform uint d;out uvec4 o;void main(){o=uvec4(d,i,0u,0u);}"));
  gl.bindAttribLocation(picking, 0, "p");
  gl.linkProgram(picking);
  var of = {m: gl.getUniformLocation(picking, "m"), s: gl.getUniformLocation(picking, "s"),
            d: gl.getUniformLocation(picking, "d")};

  function upload(target, accessor) {
    var view = doc.bufferViews[doc.accessors[accessor].bufferView];
    var buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, bytes.subarray(base + view.byteOffset,
                                         base + view.byteOffset + view.byteLength), gl.STATIC_DRAW);
  }
  var low = [1e30, 1e30, 1e30], high = [-1e30, -1e30, -1e30], draws = [], groups = [];
  var sample = [];
  function add(group, primitive, node) {
    var position = doc.accessors[primitive.attributes.POSITION];
    for (var k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], position.min[k]);
      high[k] = Math.max(high[k], position.max[k]);
    }
    var view = doc.bufferViews[position.bufferView];
    var places = new DataView(bytes.buffer, base + view.byteOffset, view.byteLength);
    for (var i = 0; i < position.count; i += Math.ceil(position.count / 2000)) {
      sample.push([0, 4, 8].map(function (o) { return places.getFloat32(12 * i + o, true); }));
    }
    var array = gl.createVertexArray();
    gl.bindVertexArray(array);
    upload(gl.ARRAY_BUFFER, primitive.attributes.POSITION);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    if ("COLOR_0" in primitive.attributes) {
      upload(gl.ARRAY_BUFFER, primitive.attributes.COLOR_0);
      gl.enableVertexAttribArray(1);
      gl.vertexAttribPointer(1, 4, gl.UNSIGNED_SHORT, true, 0, 0);
    }
    var count = position.count, indexed = "indices" in primitive;
    if (indexed) {
      upload(gl.ELEMENT_ARRAY_BUFFER, primitive.indices);
      count = doc.accessors[primitive.indices].count;
    }
    var color = doc.materials[primitive.material].pbrMetallicRoughness.baseColorFactor;
    draws.push({array: array, count: count, indexed: indexed, color: color, group: group,
                mode: primitive.mode, node: node, attributes: primitive.attributes});
  }
  function visit(group, index) {
    var node = doc.nodes[index];
    if ("mesh" in node) {
      doc.meshes[node.mesh].primitives.forEach(function (p) { add(group, p, node); });
    }
    (node.children || []).forEach(function (child) { visit(group, child); });
  }
  // A switch for each of the scene's top nodes.
  doc.scenes[0].nodes.forEach(function (index) {
    var group = {shown: true}, label = document.createElement("label");
    var box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", function () { group.shown = box.checked; redraw(); });
    label.append(box, " " + doc.nodes[index].name);
    groups.push(label);
    visit(group, index);
  });
  gl.bindVertexArray(null);
  draws.sort(function (a, b) { return b.color[3] - a.color[3]; });

  var target = [0, 1, 2].map(function (k) { return (low[k] + high[k]) / 2; });
  var size = Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) || 1;
  var middle = target.slice(), azimuth = 0.7, elevation = 0.4, distance = 0;

  function axes() {
    var ce = Math.cos(elevation), se = Math.sin(elevation);
    var back = [ce * Math.sin(azimuth), se, ce * Math.cos(azimuth)];
    var right = [Math.cos(azimuth), 0, -Math.sin(azimuth)];
    var up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2],
              back[0] * right[1] - back[1] * right[0]];
    return [right, up, back];
  }
  /// Looks at the middle of what is seen, as near as shows all of it.
  function fit(w, h) {
    var a = axes(), f = 1 / Math.tan(0.35), d = size;
    function project(p) {
      var c = p.map(function (v, k) { return v - target[k]; });
      return a.map(function (u) { return u[0] * c[0] + u[1] * c[1] + u[2] * c[2]; });
    }
    for (var round = 0; round < 4; round++) {
      var from = [1e30, 1e30], to = [-1e30, -1e30], need = 0.01 * size;
      var seen = sample.map(project);
      seen.forEach(function (p) {
        for (var k = 0; k < 2; k++) {
          var s = p[k] / Math.max(d - p[2], 1e-3 * size);
          from[k] = Math.min(from[k], s);
          to[k] = Math.max(to[k], s);
        }
      });
      var shift = [0, 1].map(function (k) { return d * (from[k] + to[k]) / 2; });
      for (var k = 0; k < 3; k++) target[k] += shift[0] * a[0][k] + shift[1] * a[1][k];
      seen.forEach(function (p) {
        var x = Math.abs(p[0] - shift[0]) * h / w, y = Math.abs(p[1] - shift[1]);
        need = Math.max(need, p[2] + 1.1 * f * Math.max(x, y));
      });
      d = need;
    }
    return d;
  }
  /// The projection of a canvas of w by h pixels; column by column.
  function matrix(w, h) {
    var a = axes(), f = 1 / Math.tan(0.35), near = distance * 0.01, far = distance + 4 * size;
    var eye = target.map(function (t, k) { return t + distance * a[2][k]; });
    function dot(u) { return u[0] * eye[0] + u[1] * eye[1] + u[2] * eye[2]; }
    var px = f * h / w, py = f, pz = (far + near) / (near - far), pw = 2 * far * near / (near - far);
    var m = new Float32Array(16), t = [-dot(a[0]), -dot(a[1]), -dot(a[2])];
    for (var c = 0; c < 4; c++) {
      var x = c < 3 ? a[0][c] : t[0], y = c < 3 ? a[1][c] : t[1], z = c < 3 ? a[2][c] : t[2];
      m[4 * c] = px * x;
      m[4 * c + 1] = py * y;
      m[4 * c + 2] = pz * z + (c === 3 ? pw : 0);
      m[4 * c + 3] = -z;
    }
    return m;
  }
  function draw_part(d) {
    if (d.indexed) gl.drawElements(d.mode, d.count, gl.UNSIGNED_INT, 0);
    else gl.drawArrays(d.mode, 0, d.count);
  }
  var chosen = null;  // {draw, vertex}
  function draw() {
    gl.useProgram(program);
    var ratio = window.devicePixelRatio || 1;
    var w = Math.max(1, Math.round(canvas.clientWidth * ratio));
    var h = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    if (distance === 0) distance = fit(w, h);
    gl.viewport(0, 0, w, h);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniformMatrix4fv(at.m, false, matrix(w, h));
    gl.uniform1f(at.s, 2 * ratio);
    draws.forEach(function (d) {
      if (!d.group.shown) return;
      gl.bindVertexArray(d.array);
      gl.vertexAttrib4f(1, 1, 1, 1, 1);
      gl.uniform4fv(at.f, d.color);
      gl.depthMask(d.color[3] >= 1);
      gl.uniform1f(at.h, chosen && chosen.draw.node === d.node && d.mode === gl.LINES ? 1 : 0);
      draw_part(d);
    });
    gl.depthMask(true);
    if (chosen && chosen.draw.mode === gl.POINTS && chosen.draw.group.shown) {
      gl.bindVertexArray(chosen.draw.array);
      gl.uniform1f(at.h, 1);
      gl.uniform1f(at.s, 9 * ratio);
      gl.drawArrays(gl.POINTS, chosen.vertex, 1);
    }
  }
  /// The part and the vertex that are drawn nearest to a place of the canvas, in its CSS pixels.
  function pick(x, y) {
    var ratio = window.devicePixelRatio || 1, w = canvas.width, h = canvas.height;
    var frame = gl.createFramebuffer(), ink = gl.createRenderbuffer();
    var depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, ink);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA32UI, w, h);
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, w, h);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, ink);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    gl.useProgram(picking);
    gl.viewport(0, 0, w, h);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    var reach = Math.round(4 * ratio), side = 2 * reach + 1;
    var left = Math.round(x * ratio) - reach, bottom = h - 1 - Math.round(y * ratio) - reach;
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(left, bottom, side, side);
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
    gl.uniformMatrix4fv(of.m, false, matrix(w, h));
    gl.uniform1f(of.s, 3 * ratio);
    draws.forEach(function (d, i) {
      if (!d.group.shown) return;
      gl.bindVertexArray(d.array);
      gl.uniform1ui(of.d, i + 1);
      draw_part(d);
    });
    gl.disable(gl.SCISSOR_TEST);
    var seen = new Uint32Array(4 * side * side), best = null, least = 1e9;
    gl.readPixels(left, bottom, side, side, gl.RGBA_INTEGER, gl.UNSIGNED_INT, seen);
    for (var i = 0; i < side * side; i++) {
      var part = seen[4 * i], dx = i % side - reach, dy = Math.floor(i / side) - reach;
      if (part === 0 || dx * dx + dy * dy >= least) continue;
      least = dx * dx + dy * dy;
      best = {draw: draws[part - 1], vertex: seen[4 * i + 1]};
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(frame);
    gl.deleteRenderbuffer(ink);
    gl.deleteRenderbuffer(depth);
    return best;
  }
  /// A number of a float accessor.
  function value(accessor, index) {
    var a = doc.accessors[accessor], view = doc.bufferViews[a.bufferView];
    return new DataView(bytes.buffer, base + view.byteOffset).getFloat32(4 * index, true);
  }
  function with_sigma(v, sigma, digits, unit) {
    if (typeof v !== "number") return "not known";
    return v.toFixed(digits) +
        (typeof sigma === "number" && sigma > 0 ? " \u00b1 " + sigma.toFixed(digits) : "") + " " +
        unit;
  }
  /// What is known of a thing, in lines.
  function facts(hit) {
    var node = hit.draw.node, x = node.extras || {}, unit = x.unit || "m", out = [];
    if (hit.draw.mode === gl.POINTS) {
      var of_it = hit.draw.attributes;
      out.push("road point");
      var at_x = value(of_it.POSITION, 3 * hit.vertex);
      var at_y = value(of_it.POSITION, 3 * hit.vertex + 1);
      var at_z = value(of_it.POSITION, 3 * hit.vertex + 2);
      out.push("right " + at_x.toFixed(2) + ", ahead " + (-at_z).toFixed(2) + ", up " +
               with_sigma(at_y, null, 2, unit));
      if ("_SIGMA" in of_it) {
        out.push("sigma along the ray " +
                 with_sigma(value(of_it._SIGMA, hit.vertex), null, 3, unit));
      }
      var patch = "_PATCH" in of_it ? value(of_it._PATCH, hit.vertex) : -1;
      if (patch >= 0) {
        doc.nodes.forEach(function (n) {
          if (n.name === "patch " + patch) out.push(facts({draw: {node: n}}));
        });
      }
      return out.join("\n");
    }
    out.push(node.name + (x.kind ? ", " + x.kind : "") +
             (x.status ? ", " + x.status.replace("_", " ") : "") +
             ("id_in_frame" in x && x.id_in_frame !== x.id ? " (id " + x.id_in_frame +
              " in this frame)" : ""));
    if (x.reason) out.push(x.reason);
    if ("range" in x) out.push("distance " + with_sigma(x.range, x.range_sigma, 2, unit));
    if ("grade_deg" in x) {
      out.push("grade " + with_sigma(x.grade_deg, x.grade_sigma_deg, 2, "deg") + ", bank " +
               with_sigma(x.bank_deg, x.bank_sigma_deg, 2, "deg"));
      out.push("height known to " + with_sigma(x.height_sigma, null, 3, unit) + ", " + x.points +
               " points");
    }
    if ("length" in x) {
      out.push("length " + x.length.toFixed(2) + ", width " + x.width.toFixed(2) + ", height " +
               x.height.toFixed(2) + " " + unit);
    }
    return out.join("\n");
  }
  var said = document.getElementById("viewsaid"), pressed = null;
  function choose(x, y) {
    chosen = pick(x, y);
    said.textContent = chosen ? facts(chosen) : "nothing here";
    redraw();
  }
  var pending = false;
  function redraw() {
    if (pending) return;
    pending = true;
    requestAnimationFrame(function () { pending = false; draw(); });
  }
  function pan(dx, dy) {
    var a = axes(), s = distance * 0.73 / canvas.clientHeight;
    for (var k = 0; k < 3; k++) target[k] += s * (-dx * a[0][k] + dy * a[1][k]);
  }
  var fingers = new Map();
  canvas.addEventListener("pointerdown", function (e) {
    canvas.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, {x: e.clientX, y: e.clientY});
    pressed = fingers.size === 1 ? {x: e.clientX, y: e.clientY} : null;
  });
  canvas.addEventListener("pointerup", function (e) {
    if (pressed && Math.hypot(e.clientX - pressed.x, e.clientY - pressed.y) < 4) {
      var box = canvas.getBoundingClientRect();
      choose(e.clientX - box.left - canvas.clientLeft, e.clientY - box.top - canvas.clientTop);
    }
    pressed = null;
  });
  ["pointerup", "pointercancel"].forEach(function (name) {
    canvas.addEventListener(name, function (e) { fingers.delete(e.pointerId); });
  });
  canvas.addEventListener("pointermove", function (e) {
    var last = fingers.get(e.pointerId);
    if (!last) return;
    var dx = e.clientX - last.x, dy = e.clientY - last.y;
    if (fingers.size === 2) {
      var other = null;
      fingers.forEach(function (v, id) { if (id !== e.pointerId) other = v; });
      var before = Math.hypot(last.x - other.x, last.y - other.y);
      var after = Math.hypot(e.clientX - other.x, e.clientY - other.y);
      if (before > 0 && after > 0) distance *= before / after;
      pan(dx / 2, dy / 2);
    } else if (e.buttons & 2 || e.shiftKey) {
      pan(dx, dy);
    } else {
      azimuth -= dx * 0.008;
      elevation = Math.min(1.55, Math.max(-1.55, elevation + dy * 0.008));
    }
    last.x = e.clientX;
    last.y = e.clientY;
    redraw();
  });
  canvas.addEventListener("wheel", function (e) {
    e.preventDefault();
    distance = Math.min(20 * size, Math.max(0.001 * size, distance * Math.exp(e.deltaY * 0.001)));
    redraw();
  }, {passive: false});
  canvas.addEventListener("contextmenu", function (e) { e.preventDefault(); });
  canvas.addEventListener("dblclick", function () {
    target = middle.slice();
    azimuth = 0.7;
    elevation = 0.4;
    distance = 0;
    redraw();
  });
  window.addEventListener("resize", redraw);
  groups.forEach(function (label) { document.getElementById("viewbar").append(label); });
  canvas.style.display = "block";
  document.getElementById("viewnote").hidden = false;
  draw();
})();
)JS";

const char* const kReportAnswers = R"JS(
(function () {
  "use strict";
  function answer(e) {
    var area = e.target.closest ? e.target.closest(".hit") : null;
    if (!area) return;
    var said = area.closest(".answers").querySelector(".said");
    var title = area.querySelector("title");
    said.textContent = title ? title.textContent : area.getAttribute("title");
  }
  ["pointerover", "pointerdown", "focusin"].forEach(function (name) {
    document.addEventListener(name, answer);
  });
})();
)JS";

}  // namespace camber
