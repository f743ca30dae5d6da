// The report in a browser without network: it complains of nothing and its 3D view draws. Skipped
// where Chromium is not installed.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <regex>
#include <string>

#include "camber/render/report.h"
#include "picture_content.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using test::PictureScene;
using ::testing::HasSubstr;
using ::testing::Not;

std::string read_text(const fs::path& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string find_browser() {
  for (const char* name :
       {"/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"}) {
    if (fs::exists(name)) return name;
  }
  return {};
}

/// Loads a page of `folder` and gives back its DOM after its scripts; messages go to log.txt.
std::string load_page(const std::string& browser, const fs::path& folder, const std::string& name,
                      const std::string& more = "") {
  const std::string f = folder.string();
  const std::string command =
      "timeout 120 " + browser +
      " --headless=new --no-sandbox --disable-dev-shm-usage --no-first-run --user-data-dir=" + f +
      "/profile --hide-scrollbars --use-gl=angle --use-angle=swiftshader "
      "--enable-unsafe-swiftshader --enable-logging=stderr --virtual-time-budget=10000 "
      "--host-resolver-rules='MAP * ~NOTFOUND' " +
      more + " --dump-dom file://" + f + "/" + name + " > " + f + "/dom.html 2> " + f +
      "/log.txt < /dev/null";
  EXPECT_EQ(std::system(command.c_str()), 0);
  return read_text(folder / "dom.html");
}

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
  document.title = "ink " + ink + " of " + w * h + " colours " + colors.size + " x " +
      Math.round(100 * left / w) + " " + Math.round(100 * right / w) + " y " +
      Math.round(100 * top / h) + " " + Math.round(100 * bottom / h) + " error " + gl.getError();
});
</script></body>)";

TEST(ReportInABrowser, DrawsItsViewAndComplainsOfNothing) {
  const std::string browser = find_browser();
  if (browser.empty()) GTEST_SKIP() << "no Chromium here: the report is not opened";
  const PictureScene scene;
  const test::TemporaryFolder folder;
  ReportContent content;
  content.picture = scene.content();
  std::string page = make_report(content);
  page.replace(page.rfind("</body>"), 7, kProbe);
  for (const char* size : {"1200,900", "500,900"}) {
    std::ofstream(folder.path() / "page.html") << page;
    const std::string dom =
        load_page(browser, folder.path(), "page.html", std::string("--window-size=") + size);
    const std::string log = read_text(folder.path() / "log.txt");
    EXPECT_THAT(log, Not(HasSubstr("CONSOLE"))) << log;
    ASSERT_THAT(dom, HasSubstr("<title>")) << log;
    std::smatch m;
    const std::regex told(
        "<title>ink (\\d+) of (\\d+) colours (\\d+) x (\\d+) (\\d+) y (\\d+) (\\d+) error 0");
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
  // Refused was the view's script, and nothing else was asked for.
  const std::string log = read_text(folder.path() / "log.txt");
  std::size_t refused = 0;
  for (std::size_t at = log.find("CONSOLE"); at != std::string::npos;
       at = log.find("CONSOLE", at + 1)) {
    ++refused;
  }
  EXPECT_EQ(refused, 1u) << log;
}

}  // namespace
}  // namespace camber
