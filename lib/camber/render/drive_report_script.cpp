#include "camber/render/drive_report_script.h"

namespace camber {

const char* const kDriveReportScript = R"JS(
(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("drive").textContent);
  var frames = data.frames, slider = document.getElementById("at");
  var shot = document.getElementById("shot"), now = document.getElementById("now");
  var shown = Object.keys(data.pictures).map(Number).sort(function (a, b) { return a - b; });
  var ID = 0, TIME = 1, STATION = 2, X = 3, Y = 4, S = 5, SPEED = 6, GRADE = 8, BANK = 10,
      HEIGHT = 12, STATUS = 14, REASON = 15;

  // Every panel of the plots with what takes values to its pixels.
  var panels = [];
  ["map", "profile"].forEach(function (name) {
    var place = document.getElementById(name);
    if (!place) return;
    place.querySelectorAll("svg").forEach(function (svg) {
      svg.style.cursor = "crosshair";
      svg.querySelectorAll(".axes").forEach(function (axes) {
        var box = axes.dataset.box.split(" ").map(Number);
        var range = axes.dataset.range.split(" ").map(Number);
        var mark = document.createElementNS("http://www.w3.org/2000/svg",
                                            name === "map" ? "circle" : "line");
        mark.setAttribute("stroke", "#c0007a");
        mark.setAttribute("stroke-width", "2");
        mark.setAttribute("fill", "none");
        mark.setAttribute("pointer-events", "none");
        axes.append(mark);
        panels.push({svg: svg, map: name === "map", box: box, range: range, mark: mark});
      });
      svg.addEventListener("click", function (e) { choose(svg, e); });
    });
  });

  function pixel(panel, x, y) {
    var b = panel.box, r = panel.range;
    return [b[0] + (x - r[0]) / (r[1] - r[0]) * (b[2] - b[0]),
            b[3] - (y - r[2]) / (r[3] - r[2]) * (b[3] - b[1])];
  }
  function put(mark, values) {
    Object.keys(values).forEach(function (key) { mark.setAttribute(key, values[key]); });
  }
  function text(value, sigma, decimals, unit) {
    if (value === null) return null;
    return value.toFixed(decimals) +
        (sigma === null ? "" : " \u00b1 " + sigma.toFixed(decimals)) + " " + unit;
  }
  function nearest(list, i) {
    return list.reduce(function (best, k) {
      return Math.abs(k - i) < Math.abs(best - i) ? k : best;
    }, list[0]);
  }
  function show(i) {
    var f = frames[i];
    slider.value = i;
    if (shot && shown.length) {
      shot.src = "data:image/jpeg;base64," + data.pictures[nearest(shown, i)];
    }
    var facts = ["frame " + f[ID], text(f[TIME], null, 2, "s"), text(f[S], null, 1, data.unit),
                 text(f[SPEED], f[SPEED + 1], 2, data.unit + "/s")];
    [[GRADE, "grade", 2, "%"], [BANK, "cross slope", 2, "%"],
     [HEIGHT, "camera", 3, data.unit]].forEach(function (n) {
      var told = text(f[n[0]], f[n[0] + 1], n[2], n[3]);
      if (told) facts.push(n[1] + " " + told);
    });
    if (f[STATUS] !== "ok") facts.push(f[STATUS] + (f[REASON] ? ": " + f[REASON] : ""));
    now.textContent = facts.filter(Boolean).join(", ");
    panels.forEach(function (panel) {
      var known = panel.map ? f[X] !== null : f[STATION] !== null;
      panel.mark.style.display = known ? "" : "none";
      if (!known) return;
      if (panel.map) {
        var p = pixel(panel, f[X], f[Y]);
        put(panel.mark, {cx: p[0], cy: p[1], r: 7});
      } else {
        var x = pixel(panel, f[STATION], panel.range[2])[0];
        put(panel.mark, {x1: x, x2: x, y1: panel.box[1], y2: panel.box[3]});
      }
    });
  }
  function choose(svg, e) {
    var r = svg.getBoundingClientRect(), v = svg.viewBox.baseVal;
    var x = (e.clientX - r.left) * v.width / r.width, y = (e.clientY - r.top) * v.height / r.height;
    var best = -1, least = 1e30;
    panels.forEach(function (panel) {
      var b = panel.box;
      if (panel.svg !== svg || x < b[0] || x > b[2] || y < b[1] || y > b[3]) return;
      frames.forEach(function (f, i) {
        var away;
        if (panel.map && f[X] !== null) {
          var p = pixel(panel, f[X], f[Y]);
          away = Math.hypot(p[0] - x, p[1] - y);
        } else if (!panel.map && f[STATION] !== null) {
          away = Math.abs(pixel(panel, f[STATION], 0)[0] - x);
        } else {
          return;
        }
        if (away < least) { least = away; best = i; }
      });
    });
    if (best >= 0) show(best);
  }
  function follow() {
    var id = Number((location.hash.match(/^#f(\d+)$/) || [])[1]);
    var i = frames.findIndex(function (f) { return f[ID] === id; });
    if (i < 0) return false;
    show(i);
    document.getElementById("frame").scrollIntoView();
    return true;
  }
  slider.addEventListener("input", function () { show(Number(slider.value)); });
  window.addEventListener("hashchange", follow);
  if (!follow()) show(0);
})();
)JS";

}  // namespace camber
