// Pictures, plots and the report of a made drive.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "browser.h"
#include "camber/image/image_io.h"
#include "camber/render/drive_painter.h"
#include "camber/render/drive_plots.h"
#include "camber/render/drive_report.h"
#include "camber/render/label_layout.h"
#include "camber/render/picture_file.h"
#include "drive_maker.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::PicturedDrive;
using ::testing::HasSubstr;

TEST(LabelLayout, KeepsTheSideOfThePictureBefore) {
  LabelLayoutOptions options;
  options.area = {0, 0, 400, 300};
  LabelRequest request;
  request.size = {60, 20};
  request.target = {150, 100, 200, 140};
  const LabelPlace free = place_labels({request}, options)[0];
  EXPECT_LT(free.box.y2, request.target.y1);  // above
  // Something there pushes it away; when it is gone the label stays where it went.
  options.taken = {free.box};
  const LabelPlace pushed = place_labels({request}, options)[0];
  ASSERT_TRUE(pushed.found);
  EXPECT_NE(pushed.candidate, free.candidate);
  options.taken.clear();
  request.preferred = pushed.candidate;
  EXPECT_EQ(place_labels({request}, options)[0].candidate, pushed.candidate);
  // The target moves by a few pixels, and so does the label.
  request.target = {154, 103, 204, 143};
  const LabelPlace moved = place_labels({request}, options)[0];
  EXPECT_EQ(moved.candidate, pushed.candidate);
  EXPECT_NEAR(moved.box.x1 - pushed.box.x1, 4.0, 1e-9);
  EXPECT_NEAR(moved.box.y1 - pushed.box.y1, 3.0, 1e-9);
}

TEST(DrivePlots, ProfileIsThatOfTheRoad) {
  const PicturedDrive made;
  const DriveContent content = made.content();
  const std::vector<ProfilePoint> profile = drive_profile(content);
  ASSERT_GT(profile.size(), 30U);
  std::size_t known = 0;
  for (const ProfilePoint& p : profile) {
    if (!std::isfinite(p.grade)) continue;
    ++known;
    EXPECT_NEAR(p.grade, 0.05, 2.0 * p.sigma_grade);
    EXPECT_NEAR(p.height, 0.05 * p.station, 3.0 * p.sigma_height);
    EXPECT_NEAR(p.cross_slope, 0.0, 2.0 * p.sigma_cross_slope);
  }
  EXPECT_GT(known, 25U);
  // The height of the path is the less known the farther it went.
  EXPECT_GT(profile[35].sigma_height, profile[5].sigma_height);
  const std::vector<double> stations = frame_stations(content);
  EXPECT_NEAR(stations[10], 7.0, 0.01);
  const PlotSheet sheet = drive_profile_plots(content, profile);
  EXPECT_EQ(sheet.panels.size(), 4U);
  // Places on the axes are where a plot draws them.
  const PlotStyle style{760, 200, 16.0};
  const std::vector<PlotAxes> axes = plot_axes(sheet, style);
  ASSERT_EQ(axes.size(), 4U);
  EXPECT_LT(axes[0].box.y2, axes[1].box.y1);
  EXPECT_NEAR(axes[0].pixel(axes[0].x_low, axes[0].y_high).x(), axes[0].box.x1, 1e-9);
  EXPECT_NEAR(axes[0].pixel(axes[0].x_low, axes[0].y_high).y(), axes[0].box.y1, 1e-9);
}

TEST(DrivePainter, DrawsFramesOfOneSize) {
  const PicturedDrive made;
  const DriveContent content = made.content();
  const DrivePainter painter(content);
  EXPECT_EQ(painter.width() % 32, 0);
  EXPECT_EQ(painter.height() % 32, 0);
  const Image photo = make_picture(320, 120, 128);
  LabelMemory labels;
  for (const std::size_t frame : {0U, 30U, 59U}) {
    const Image overlay = painter.overlay(photo, frame, &labels);
    EXPECT_EQ(overlay.width, painter.width());
    const Image picture = painter.picture(overlay, frame);
    EXPECT_EQ(picture.width, painter.width());
    EXPECT_EQ(picture.height, painter.height());
    const std::ptrdiff_t half_row = 3 * (picture.width / 2);
    EXPECT_EQ(std::count(picture.data.end() - half_row, picture.data.end(), 255), half_row)
        << "the plots are cut off";
    // The road ahead is painted, the sky is not.
    const auto at = [&](int x, int y) {
      const std::uint8_t* p =
          overlay.data.data() + 3 * (static_cast<std::size_t>(y) * overlay.width + x);
      return std::array<int, 3>{p[0], p[1], p[2]};
    };
    EXPECT_EQ(at(overlay.width / 2 + 40, 8), (std::array<int, 3>{128, 128, 128}));
    EXPECT_NE(at(overlay.width / 2 - 60, overlay.height - 20), (std::array<int, 3>{128, 128, 128}));
  }
  EXPECT_EQ(labels.candidates.count(5), 1U);  // the car ahead is labelled in the last one
  EXPECT_EQ(painter.overlay(photo, 7, nullptr).data, painter.overlay(photo, 7, nullptr).data);
}

DriveReport report_of(const PicturedDrive& made) {
  DriveReport report;
  report.content = made.content();
  const std::string jpeg = encode_jpeg(make_picture(64, 24, 200));
  report.pictures = {{0, jpeg}, {30, encode_jpeg(make_picture(64, 24, 20))}};
  report.film = "film.mp4";
  report.run =
      nlohmann::json{{"seed", 0},
                     {"scene", "x </script><b>"},
                     {"windows", {{{"reference", 110}, {"residual_sigma", 6.5}, {"weight", 0.05}}}},
                     {"warnings", {{{"code", "x"}, {"text", "2 < 3 frames"}}}}};
  return report;
}

TEST(DriveReport, HasItsTablesWithoutScripts) {
  const PicturedDrive made;
  const std::string page = make_drive_report(report_of(made));
  EXPECT_THAT(page, HasSubstr("41.30 <span class=m>&plusmn; 0.50"));
  EXPECT_THAT(page, HasSubstr("<a href=\"#f130\">130</a>"));
  EXPECT_THAT(page, HasSubstr("the picture of frame 129"));
  EXPECT_THAT(page, HasSubstr("car 5"));
  EXPECT_THAT(page, HasSubstr("outvoted"));
  EXPECT_THAT(page, HasSubstr("2 &lt; 3 frames"));
  EXPECT_THAT(page, ::testing::Not(HasSubstr("</script><b>")));
  for (const char* elsewhere : {"http://", "https://", "src=\"/", "@import"}) {
    std::string rest = page;
    for (std::size_t at = 0;
         (at = rest.find("http://www.w3.org/2000/svg", at)) != std::string::npos;) {
      rest.erase(at, 26);  // a name, no address
    }
    EXPECT_THAT(rest, ::testing::Not(HasSubstr(elsewhere)));
  }
}

/// Moves the slider, clicks the map and a plot, follows a link, and leaves what the page shows.
const char* const kDriveProbe = R"(<script>
window.addEventListener("load", function () {
  var read = {}, now = document.getElementById("now"), shot = document.getElementById("shot");
  read.first = now.textContent;
  var before = shot.src, slider = document.getElementById("at");
  slider.value = 40;
  slider.dispatchEvent(new Event("input"));
  read.moved = now.textContent;
  read.picture = shot.src !== before;
  function click(id, panel, x, y) {
    var svg = document.querySelector("#" + id + " .wide svg");
    var axes = svg.querySelectorAll(".axes")[panel];
    var b = axes.dataset.box.split(" ").map(Number), r = axes.dataset.range.split(" ").map(Number);
    var place = svg.getBoundingClientRect(), view = svg.viewBox.baseVal;
    var px = b[0] + (x - r[0]) / (r[1] - r[0]) * (b[2] - b[0]);
    var py = b[3] - (y - r[2]) / (r[3] - r[2]) * (b[3] - b[1]);
    svg.dispatchEvent(new MouseEvent("click", {bubbles: true,
      clientX: place.left + px * place.width / view.width,
      clientY: place.top + py * place.height / view.height}));
    return now.textContent;
  }
  read.plot = click("profile", 1, 14.0, 5.0);
  read.map = click("map", 0, 27.56, 4.3);  // 28 m along the bend
  location.hash = "#f130";
  window.dispatchEvent(new Event("hashchange"));
  read.link = now.textContent;
  read.marks = document.querySelectorAll("#map .wide circle[cx], #profile .wide line[x1]").length;
  read.wide = document.documentElement.scrollWidth <= document.documentElement.clientWidth;
  var note = document.createElement("pre");
  note.id = "read";
  note.textContent = JSON.stringify(read);
  document.body.append(note);
});
</script></body>)";

TEST(DriveReport, LeadsFromPlotsToFramesInABrowser) {
  const std::string browser = test::find_browser();
  if (browser.empty()) GTEST_SKIP() << "no Chromium here: the report is not opened";
  const PicturedDrive made;
  std::string page = make_drive_report(report_of(made));
  page.replace(page.rfind("</body>"), 7, kDriveProbe);
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "page.html") << page;
  const std::string dom =
      test::load_page(browser, folder.path(), "page.html", "--window-size=1200,900");
  EXPECT_THAT(test::complaints(test::read_text(folder.path() / "log.txt")), ::testing::IsEmpty());
  const std::size_t from = dom.find("<pre id=\"read\">");
  ASSERT_NE(from, std::string::npos) << dom.substr(0, 500);
  const nlohmann::json read =
      nlohmann::json::parse(dom.substr(from + 15, dom.find("</pre>", from) - from - 15));
  EXPECT_THAT(read.at("first").get<std::string>(), HasSubstr("frame 100, 0.00 s"));
  EXPECT_THAT(read.at("moved").get<std::string>(), HasSubstr("frame 140, 4.00 s, 28.0 m"));
  EXPECT_TRUE(read.at("picture").get<bool>());
  EXPECT_THAT(read.at("plot").get<std::string>(), HasSubstr("frame 120,"));
  EXPECT_THAT(read.at("map").get<std::string>(), HasSubstr("frame 140,"));
  EXPECT_THAT(read.at("link").get<std::string>(),
              HasSubstr("frame 130, 3.00 s, 21.0 m, 7.00 ± 0.10 m/s"));
  EXPECT_THAT(read.at("link").get<std::string>(), HasSubstr("weak: the picture of frame 129"));
  EXPECT_EQ(read.at("marks"), 5);  // the map's and four panels'
  EXPECT_TRUE(read.at("wide").get<bool>()) << "the page is wider than the window";
}

}  // namespace
}  // namespace camber
