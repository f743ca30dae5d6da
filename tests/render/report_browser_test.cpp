// The report in a browser without network: it complains of nothing and its 3D view draws. Skipped
// where Chromium is not installed.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "browser.h"
#include "camber/render/picture_file.h"
#include "camber/render/report.h"
#include "picture_content.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using test::complaints;
using test::find_browser;
using test::load_page;
using test::PictureScene;
using test::read_text;
using ::testing::HasSubstr;
using ::testing::Not;

/// Pictures are drawn at once: a busy machine's browser may end before it shows the next frame.
const char* const kAtOnce =
    "<head><script>window.requestAnimationFrame = function (f) { f(0); };</script>";

/// What the page's canvas holds after its scripts ran, told by its title.
const char* const kProbe = R"(<script>
window.addEventListener("load", function () {
  var c = document.getElementById("view"), gl = c && c.getContext("webgl2");
  if (!gl) { document.title = "no webgl"; return; }
  var w = c.width, h = c.height, p = new Uint8Array(4 * w * h), ink = 0, left = w, right = 0,
      top = h, bottom = 0, colors = new Set();
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
  for (var y = 0; y < h; y++) for (var x = 0; x < w; x++) {
    var i = 4 * (y * w + x);
    if (p[i] > 250 && p[i + 1] > 250 && p[i + 2] > 250) continue;
    ink++;
    colors.add(p[i] << 16 | p[i + 1] << 8 | p[i + 2]);
    left = Math.min(left, x); right = Math.max(right, x);
    top = Math.min(top, y); bottom = Math.max(bottom, y);
  }
  var told = "ink " + ink + " of " + w * h + " colours " + colors.size + " x " +
      Math.round(100 * left / w) + " " + Math.round(100 * right / w) + " y " +
      Math.round(100 * top / h) + " " + Math.round(100 * bottom / h) + " error " + gl.getError();
  function count() {
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
    var sum = 0, n = 0;
    for (var i = 0; i < p.length; i += 4) if (p[i] + p[i + 1] + p[i + 2] < 750) { n++; sum += i; }
    return [n, sum];
  }
  var before = count(), box = c.getBoundingClientRect();
  function pointer(type, x) {
    c.dispatchEvent(new PointerEvent(type, {pointerId: 1, clientX: box.left + x, buttons: 1,
                                            clientY: box.top + 100, bubbles: true}));
  }
  c.setPointerCapture = function () {};  // no such pointer exists
  pointer("pointerdown", 100);
  pointer("pointermove", 180);
  pointer("pointerup", 180);
  var turned = count();
  // What clicks all over the view tell, by their first lines.
  var read = {};
  function click(x, y) {
    ["pointerdown", "pointerup"].forEach(function (type) {
      c.dispatchEvent(new PointerEvent(type, {pointerId: 1, bubbles: true,
        clientX: box.left + x, clientY: box.top + y}));
    });
  }
  for (var gy = 1; gy < 10; gy++) for (var gx = 1; gx < 13; gx++) {
    click((left + gx * (right - left) / 13) * box.width / w,
          (h - top - gy * (bottom - top) / 10) * box.height / h);
    var said = document.getElementById("viewsaid").textContent;
    read[said.split("\n")[0]] = said;
  }
  click(8, 8);
  read.corner = document.getElementById("viewsaid").textContent;
  // What figures tell whoever points at them.
  function hover(area) {
    area.dispatchEvent(new PointerEvent("pointerover", {bubbles: true}));
    return area.closest(".answers").querySelector(".said").textContent;
  }
  read.image = Array.from(document.querySelectorAll(".at .hit")).map(hover);
  read.plot = Array.from(document.querySelectorAll(".wide svg .hit")).map(hover);
  var place = document.querySelector(".at .hit").getBoundingClientRect();
  var photo = document.querySelector(".at img").getBoundingClientRect();
  read.place = [(place.left - photo.left) / photo.width, place.width / photo.width];
  read.wide = document.documentElement.scrollWidth <= document.documentElement.clientWidth;
  var note = document.createElement("pre");
  note.id = "read";
  note.textContent = JSON.stringify(read);
  document.body.append(note);
  document.querySelectorAll("#viewbar input").forEach(function (b) { b.click(); });
  document.title = told + " turned " + (turned[1] !== before[1] && turned[0] > 0) + " off " +
      count()[0];
});
</script></body>)";

/// What the probe's clicks and pointing gave, as the script left it in the page.
void check_what_is_read(const std::string& dom) {
  const std::size_t from = dom.find("<pre id=\"read\">");
  ASSERT_NE(from, std::string::npos);
  std::string text = dom.substr(from + 15, dom.find("</pre>", from) - from - 15);
  for (std::size_t at = 0; (at = text.find("&amp;", at)) != std::string::npos; ++at) {
    text.replace(at, 5, "&");
  }
  const nlohmann::json read = nlohmann::json::parse(text);
  // A vehicle under its track, with its id in this frame, distance, sigma and size.
  const std::string car = read.value("car 4, ok (id 1 in this frame)", "");
  EXPECT_THAT(car, HasSubstr("distance 14.15 ± 0.50 m")) << text;
  EXPECT_THAT(car, HasSubstr("length 4.40, width 1.80, height 1.50 m"));
  const std::string patch = read.value("patch 0, road, ok", "");
  EXPECT_THAT(patch, HasSubstr("grade 0.00 ± 1.15 deg, bank 0.00 ± 0.57 deg")) << text;
  EXPECT_THAT(patch, HasSubstr("height known to 0.030 m, 321 points"));
  const std::string point = read.value("road point", "");
  EXPECT_THAT(point, HasSubstr("sigma along the ray 0.125 m")) << text;
  EXPECT_THAT(point, HasSubstr("patch 0, road, ok"));
  EXPECT_EQ(read.at("corner"), "nothing here");
  // The overlay's vehicles and the profile's curves answer to pointing.
  ASSERT_EQ(read.at("image").size(), 2u);
  EXPECT_THAT(read.at("image")[0].get<std::string>(),
              HasSubstr("car 4 (id 1 of frame 7): 14.2 ± 0.5 m, ok"));
  EXPECT_NEAR(read.at("place")[0].get<double>(), 0.5, 0.01);
  EXPECT_NEAR(read.at("place")[1].get<double>(), 0.1, 0.01);
  ASSERT_GT(read.at("plot").size(), 5u);
  EXPECT_THAT(read.at("plot")[0].get<std::string>(),
              ::testing::ContainsRegex("Height at [0-9.]+ m: -?[0-9.]+ ± [0-9.]+ m"));
  EXPECT_TRUE(read.at("wide").get<bool>()) << "the page is wider than the window";
}

TEST(ReportInABrowser, DrawsItsViewAndComplainsOfNothing) {
  const std::string browser = find_browser();
  if (browser.empty()) GTEST_SKIP() << "no Chromium here: the report is not opened";
  PictureScene scene;
  scene.cloud.sigmas.assign(scene.cloud.size(), 0.125f);
  scene.cloud.labels["patch"].assign(scene.cloud.size(), 0);
  scene.surface.patches[0].inliers = 321;
  scene.surface.patches[0].plane.covariance = Eigen::Vector3d(1e-4, 4e-4, 9e-4).asDiagonal();
  for (int i = 0; i < 8; ++i) {
    scene.surface.driven_line.emplace_back(0.0, PictureScene::road_y(1.0 * i), 1.0 * i);
  }
  for (VehicleEstimate& vehicle : scene.vehicles.frames[0].vehicles) {
    vehicle.track = vehicle.id + 3;
    vehicle.box = {621.0, 100.0, 745.2, 200.0};  // the middle tenth of the image
  }
  const test::TemporaryFolder folder;
  write_png(make_picture(1242, 375, 90), folder.path() / "overlay_000007.png");
  ReportContent content;
  content.picture = scene.content();
  content.picture_folder = folder.path();
  std::string page = make_report(content);
  page.replace(page.rfind("</body>"), 7, kProbe);
  page.replace(page.find("<head>"), 6, kAtOnce);
  for (const char* size : {"1200,900", "500,900"}) {
    std::ofstream(folder.path() / "page.html") << page;
    const std::string dom =
        load_page(browser, folder.path(), "page.html", std::string("--window-size=") + size);
    const std::string log = read_text(folder.path() / "log.txt");
    EXPECT_THAT(complaints(log), ::testing::IsEmpty());
    ASSERT_THAT(dom, HasSubstr("<title>")) << log;
    std::smatch m;
    const std::regex told(
        "<title>ink (\\d+) of (\\d+) colours (\\d+) x (\\d+) (\\d+) y (\\d+) (\\d+) error 0 "
        "turned true off (\\d+)<");
    if (dom.find("<title>no webgl") != std::string::npos) {
      GTEST_SKIP() << "this browser has no WebGL 2";
    }
    ASSERT_TRUE(std::regex_search(dom, m, told)) << dom.substr(0, 400);
    EXPECT_GT(std::stod(m[1]), 0.02 * std::stod(m[2]));  // more than stray dots
    EXPECT_GT(std::stoi(m[3]), 20);                      // points by height, patches, cars
    // The scene fills the view in one direction and touches no rim.
    const int left = std::stoi(m[4]), right = std::stoi(m[5]), bottom = std::stoi(m[6]),
              top = std::stoi(m[7]);
    EXPECT_GE(std::min({left, 100 - right, bottom, 100 - top}), 1);
    EXPECT_GT(std::max(right - left, top - bottom), 80);
    EXPECT_EQ(std::stoi(m[8]), 0) << "all parts switched off";
    check_what_is_read(dom);
    // The switches of the view are made by the script from the scene's top nodes.
    for (const char* part : {"road points", "vehicles", "truth", "cameras"}) {
      EXPECT_THAT(dom, ::testing::ContainsRegex(std::string("> ") + part + "</label>"));
    }
  }
}

TEST(ReportInABrowser, IsReadWithoutScripts) {
  const std::string browser = find_browser();
  if (browser.empty()) GTEST_SKIP() << "no Chromium here: the report is not opened";
  const PictureScene scene;
  const test::TemporaryFolder folder;
  ReportContent content;
  content.picture = scene.content();
  // A policy that forbids scripts and anything from elsewhere.
  std::string page = make_report(content);
  page.replace(page.find("<head>"), 6,
               "<head><meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; "
               "style-src 'unsafe-inline'; img-src data:\">");
  std::ofstream(folder.path() / "page.html") << page;
  const std::string dom = load_page(browser, folder.path(), "page.html");
  EXPECT_THAT(dom, HasSubstr("<h2>Vehicles</h2>"));
  EXPECT_THAT(dom, Not(HasSubstr("</label>")));
  // Refused were the scripts of the view and of the figures, and nothing else was asked for.
  const std::string log = read_text(folder.path() / "log.txt");
  EXPECT_EQ(complaints(log).size(), 2u) << log;
}

}  // namespace
}  // namespace camber
