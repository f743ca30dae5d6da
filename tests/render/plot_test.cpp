#include "camber/render/plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <regex>

#include "camber/core/errors.h"
#include "camber/render/base64.h"
#include "camber/render/picture_space.h"
#include "camber/render/result_plots.h"
#include "camber/render/vehicle_comparison.h"
#include "picture_content.h"

namespace camber {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

PlotSeries curve(int points, double factor) {
  PlotSeries s;
  s.name = "curve";
  s.color = plot_color(0);
  for (int i = 0; i < points; ++i) {
    s.x.push_back(0.1 * i);
    s.y.push_back(factor * std::sin(0.3 * i));
  }
  return s;
}

PlotSheet sheet_of(const PlotSeries& series) {
  PlotSheet sheet;
  sheet.title = "a sheet";
  Plot plot;
  plot.title = "a panel";
  plot.x.title = "time, s";
  plot.y.title = "height, m";
  plot.series = {series};
  sheet.panels = {plot};
  return sheet;
}

bool is(const Image& image, int x, int y, const Color& color) {
  const std::uint8_t* p = &image.data[3 * (static_cast<std::size_t>(y) * image.width + x)];
  return p[0] == color.red && p[1] == color.green && p[2] == color.blue;
}

int count(const Image& image, const Color& color) {
  int out = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) out += is(image, x, y, color) ? 1 : 0;
  }
  return out;
}

/// Whether nothing reaches the picture's rim: words that are cut off do.
bool rim_is_white(const Image& image) {
  const Color white{255, 255, 255, 1.0};
  for (int x = 0; x < image.width; ++x) {
    if (!is(image, x, 0, white) || !is(image, x, image.height - 1, white)) return false;
  }
  for (int y = 0; y < image.height; ++y) {
    if (!is(image, 0, y, white) || !is(image, image.width - 1, y, white)) return false;
  }
  return true;
}

TEST(Plot, NoWordIsCutOffWhateverTheNumbers) {
  for (const double factor : {1e-6, 0.01, 1.0, 123456.0, -9876543.0}) {
    for (const int width : {400, 1200}) {
      PlotSheet sheet = sheet_of(curve(50, factor));
      sheet.panels[0].series[0].label = "a long label";
      PlotSheet twice = sheet;
      twice.panels.push_back(sheet.panels[0]);
      PlotStyle style;
      style.width = width;
      style.text_size = width / 60.0 + 6.0;
      const Image picture = draw_plots(twice, style);
      EXPECT_EQ(picture.width, width);
      EXPECT_TRUE(rim_is_white(picture)) << factor << " " << width;
      EXPECT_GT(count(picture, plot_color(0)), width / 8) << factor << " " << width;
      EXPECT_EQ(picture.data, draw_plots(twice, style).data);
    }
  }
}

TEST(Plot, BoxesHaveTheAreaOfTheirValues) {
  PlotSeries boxes;
  boxes.kind = PlotSeries::Kind::kBoxes;
  boxes.x = {0.0};
  boxes.right = {1.0};
  boxes.low = {0.0};
  boxes.high = {2.0};
  boxes.color = plot_color(0);
  PlotSeries half = boxes;
  half.x = {2.0};
  half.right = {3.0};
  half.high = {1.0};
  half.color = plot_color(1);
  PlotSheet sheet = sheet_of(boxes);
  sheet.panels[0].series.push_back(half);
  sheet.panels[0].y.low = 0.0;
  const Image picture = draw_plots(sheet);
  const double a = count(picture, plot_color(0)), b = count(picture, plot_color(1));
  EXPECT_GT(b, 20000.0);
  EXPECT_NEAR(a / b, 2.0, 0.03);  // rims of a pixel
}

TEST(Plot, LabelsAtOnePlaceArePushedApartAndWordsStayInside) {
  PlotSheet sheet = sheet_of(curve(20, 1.0));
  for (int i = 0; i < 6; ++i) {
    sheet.panels[0].series.push_back(sheet.panels[0].series[0]);
    sheet.panels[0].series.back().name.clear();
    sheet.panels[0].series.back().label = "car <" + std::to_string(i) + ">";
  }
  const std::string svg = plots_svg(sheet);
  EXPECT_THAT(svg, HasSubstr("xmlns"));
  EXPECT_THAT(plots_svg(sheet, {}, false), Not(HasSubstr("http")));
  EXPECT_THAT(svg, HasSubstr("car &lt;0&gt;"));
  EXPECT_THAT(svg, HasSubstr("height, m"));
  std::smatch box;
  ASSERT_TRUE(std::regex_search(svg, box, std::regex("viewBox=\"0 0 (\\d+) (\\d+)\"")));
  const double width = std::stod(box[1]), height = std::stod(box[2]);
  const std::regex word("<text x=\"([-0-9.]+)\" y=\"([-0-9.]+)\"[^>]*>([^<]*)<");
  double last = -1e9;
  int labels = 0, words = 0;
  for (std::sregex_iterator it(svg.begin(), svg.end(), word), end; it != end; ++it, ++words) {
    const double x = std::stod((*it)[1]), y = std::stod((*it)[2]);
    EXPECT_GT(x, 0.0);
    EXPECT_LT(x, width);
    EXPECT_GT(y, 5.0);
    EXPECT_LT(y, height - 5.0);
    if ((*it)[3].str().rfind("car", 0) != 0) continue;
    EXPECT_GE(y - last, 20.0);  // the text size
    EXPECT_LT(x + Canvas::text_size("car <0>", 20.0).x(), width);
    last = y;
    ++labels;
  }
  EXPECT_EQ(labels, 6);
  EXPECT_GT(words, 12);
}

TEST(Plot, LogarithmicAxesHaveRoundTicksAndGapsAreLeftOut) {
  PlotSeries s = curve(30, 1.0);
  s.y[10] = kNaN;
  s.x[0] = 0.02;
  PlotSheet sheet = sheet_of(s);
  sheet.panels[0].x.logarithmic = true;
  const std::string svg = plots_svg(sheet);
  for (const char* tick : {">0.02<", ">0.05<", ">0.1<", ">0.5<", ">1<", ">2<"}) {
    EXPECT_THAT(svg, HasSubstr(tick));
  }
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  sheet.panels[0].x.low = 0.0;
  EXPECT_THROW(plots_svg(sheet), std::invalid_argument);
}

TEST(Plot, BadInputIsNamed) {
  EXPECT_THROW(draw_plots({}), std::invalid_argument);
  PlotSeries s = curve(4, 1.0);
  s.y.pop_back();
  EXPECT_THROW(draw_plots(sheet_of(s)), std::invalid_argument);
  s = curve(4, kNaN);
  s.y.assign(4, kNaN);
  EXPECT_THROW(draw_plots(sheet_of(s)), NoAnswerError);
  PlotStyle style;
  style.width = 100;
  EXPECT_THROW(draw_plots(sheet_of(curve(4, 1.0)), style), std::invalid_argument);
  style = {};
  style.text_size = kNaN;
  EXPECT_THROW(draw_plots(sheet_of(curve(4, 1.0)), style), std::invalid_argument);
  style = {200, 300, 20.0};  // no room beside the words
  PlotSheet crowded = sheet_of(curve(4, 1.0));
  crowded.panels[0].series[0].label = "a label of many words that goes on";
  EXPECT_THROW(draw_plots(crowded, style), std::invalid_argument);
  // A single value has a range all the same.
  EXPECT_NO_THROW(draw_plots(sheet_of(curve(1, 0.0))));
}

TEST(Plot, DashesOfACurveGoOnAcrossItsCorners) {
  // A thousand tiny segments: the share of ink is that of dash to dash and gap, whatever the cut.
  std::vector<double> shares;
  for (const int points : {2, 50, 1777}) {
    PlotSeries s;
    s.color = plot_color(0);
    s.dashed = true;
    s.thickness = 4.0;
    for (int i = 0; i < points; ++i) {
      s.x.push_back(static_cast<double>(i) / (points - 1));
      s.y.push_back(0.5);
    }
    PlotSheet sheet = sheet_of(s);
    sheet.panels[0].y.low = 0.0;
    sheet.panels[0].y.high = 1.0;
    PlotSheet solid = sheet;
    solid.panels[0].series[0].dashed = false;
    shares.push_back(1.0 * count(draw_plots(sheet), s.color) / count(draw_plots(solid), s.color));
  }
  // 0.5 of 0.9, and the round ends of 4.4 of 18 pixels.
  for (const double share : shares) EXPECT_NEAR(share, 0.68, 0.1);
}

TEST(Plot, AnImageCoversItsPlaceWithItsRowsUpright) {
  PlotSeries s;
  s.kind = PlotSeries::Kind::kImage;
  s.x = {10.0, 30.0};
  s.y = {0.0, 10.0};
  s.image.width = 2;
  s.image.height = 1;
  s.image.channels = 3;
  s.image.data = {200, 10, 20, 10, 20, 200};  // left red, right blue
  PlotSheet sheet = sheet_of(s);
  sheet.panels[0].x.low = 0.0;
  sheet.panels[0].x.high = 40.0;
  sheet.panels[0].y.low = 0.0;
  sheet.panels[0].y.high = 20.0;
  const Image picture = draw_plots(sheet);
  const int red = count(picture, {200, 10, 20, 1.0}), blue = count(picture, {10, 20, 200, 1.0});
  EXPECT_GT(red, 10000);
  EXPECT_NEAR(1.0 * red / blue, 1.0, 0.05);
  // Red to the left of blue, both in the lower half of the axes.
  int last_red = 0, first_blue = picture.width, first_row = picture.height;
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      if (is(picture, x, y, {200, 10, 20, 1.0})) {
        last_red = std::max(last_red, x);
        first_row = std::min(first_row, y);
      }
      if (is(picture, x, y, {10, 20, 200, 1.0})) first_blue = std::min(first_blue, x);
    }
  }
  EXPECT_LT(last_red, first_blue);
  EXPECT_GT(first_row, picture.height / 3);
  EXPECT_THAT(plots_svg(sheet), HasSubstr("data:image/png;base64,iVBORw0KGgo"));
  sheet.panels[0].series[0].x = {30.0, 10.0};
  EXPECT_THROW(draw_plots(sheet), std::invalid_argument);
  sheet.panels[0].series[0].x = {10.0, 30.0};
  sheet.panels[0].series[0].image.data.pop_back();
  EXPECT_THROW(draw_plots(sheet), std::invalid_argument);
}

TEST(Base64, VectorsOfRfc4648) {
  const std::pair<const char*, const char*> vectors[] = {{"", ""},
                                                         {"f", "Zg=="},
                                                         {"fo", "Zm8="},
                                                         {"foo", "Zm9v"},
                                                         {"foob", "Zm9vYg=="},
                                                         {"fooba", "Zm9vYmE="},
                                                         {"foobar", "Zm9vYmFy"}};
  for (const auto& [bytes, letters] : vectors) EXPECT_EQ(base64(bytes), letters);
}

TEST(Plot, EqualScalesHoldForAllPanelsOfASheet) {
  PlotSeries box;  // 4 x 2
  box.kind = PlotSeries::Kind::kBoxes;
  box.x = {3.0};
  box.right = {7.0};
  box.low = {0.0};
  box.high = {2.0};
  box.color = plot_color(0);
  PlotSheet sheet = sheet_of(box);
  sheet.panels[0].equal_scale = true;
  sheet.panels[0].x.low = 0.0;
  sheet.panels[0].x.high = 40.0;
  sheet.panels.push_back(sheet.panels[0]);
  sheet.panels[1].series[0].color = plot_color(1);
  sheet.panels[1].y.low = -20.0;  // needs the smaller scale
  sheet.panels[1].y.high = 20.0;
  const Image picture = draw_plots(sheet);
  for (int k = 0; k < 2; ++k) {
    int x1 = picture.width, x2 = 0, y1 = picture.height, y2 = 0;
    for (int y = 0; y < picture.height; ++y) {
      for (int x = 0; x < picture.width; ++x) {
        if (!is(picture, x, y, plot_color(k))) continue;
        x1 = std::min(x1, x);
        x2 = std::max(x2, x);
        y1 = std::min(y1, y);
        y2 = std::max(y2, y);
      }
    }
    EXPECT_NEAR(x2 - x1, 2.0 * (y2 - y1), 4.0) << k;
  }
  const double a = count(picture, plot_color(0)), b = count(picture, plot_color(1));
  EXPECT_NEAR(a / b, 1.0, 0.1);
}

std::vector<EvaluatedScene> two_methods() {
  std::vector<EvaluatedScene> out(2);
  for (int k = 0; k < 2; ++k) {
    out[static_cast<std::size_t>(k)].scene = "hill";
    out[static_cast<std::size_t>(k)].method = k == 0 ? "joint" : "flat";
    for (int frame = 0; frame < 4; ++frame) {
      for (int id = 1; id <= 2; ++id) {
        VehicleError error;
        error.frame = frame;
        error.truth_id = id;
        error.answered = !(k == 1 && frame == 3);
        error.center_error = error.answered ? 0.1 * (frame + 1) + 3.0 * k : kNaN;
        error.height_error = error.answered ? -0.02 * (frame + 1) : kNaN;
        error.true_depth = 10.0 * id + frame;
        error.depth = error.answered ? error.true_depth + 0.5 : kNaN;
        error.depth_sigma = error.answered ? 0.25 : kNaN;
        out[static_cast<std::size_t>(k)].metrics.vehicles.push_back(error);
      }
    }
  }
  return out;
}

TEST(ResultPlots, HistogramSharesAndCurvesCountTheUnanswered) {
  for (const PlottedError which : {PlottedError::kCenter, PlottedError::kGround}) {
    const PlotSheet sheet = error_plots(two_methods(), which);
    ASSERT_EQ(sheet.panels.size(), 2u);
    for (int k = 0; k < 2; ++k) {
      const double answered = k == 0 ? 100.0 : 75.0;
      const PlotSeries& bars = sheet.panels[0].series.at(static_cast<std::size_t>(k));
      double sum = 0.0;
      for (const double share : bars.high) sum += share;
      EXPECT_NEAR(sum, answered, 1e-9);
      const PlotSeries& steps = sheet.panels[1].series.at(static_cast<std::size_t>(k));
      EXPECT_NEAR(steps.y.back(), answered, 1e-9);
      EXPECT_TRUE(std::is_sorted(steps.y.begin(), steps.y.end()));
    }
    EXPECT_THAT(sheet.panels[0].series[1].name, HasSubstr("2 without an answer"));
    EXPECT_TRUE(rim_is_white(draw_plots(sheet)));
  }
  // The errors of "flat" are 3.1, 3.2 and 3.3 m, those of "joint" 0.1 to 0.4 m.
  const PlotSheet sheet = error_plots(two_methods(), PlottedError::kCenter);
  EXPECT_THAT(sheet.panels[0].series[0].name, HasSubstr("median 0.25 m"));
  EXPECT_NEAR(sheet.panels[0].series[1].high.back(), 75.0, 1e-9);  // the last bar: all beyond
  std::vector<EvaluatedScene> nothing = two_methods();
  for (EvaluatedScene& scene : nothing) scene.metrics.vehicles.clear();
  EXPECT_THROW(error_plots(nothing, PlottedError::kCenter), NoAnswerError);
  EXPECT_THROW(depth_plots(nothing, {}), NoAnswerError);
}

TEST(ResultPlots, ManyVehiclesKeepTheirPanel) {
  std::vector<EvaluatedScene> scenes(1);
  scenes[0].scene = "drive";
  scenes[0].method = "joint";
  for (int id = 0; id < 70; ++id) {
    for (int frame = 5 * id; frame < 5 * id + 30; ++frame) {
      VehicleError error;
      error.frame = frame;
      error.truth_id = id;
      error.answered = true;
      error.true_depth = error.depth = 60.0 - (frame - 5 * id);
      error.depth_sigma = 1.0;
      error.center_error = 0.0;
      scenes[0].metrics.vehicles.push_back(error);
    }
  }
  const PlotSheet sheet = depth_plots(scenes, {});
  const std::string svg = plots_svg(sheet);
  // Labels too many for a column stay inside the axes, and no two of them meet.
  const std::regex word(
      "<text x=\"([-0-9.]+)\" y=\"([-0-9.]+)\"[^>]*font-size=\"12.8\"[^>]*>(\\d+)<");
  std::vector<Box2> boxes;
  for (std::sregex_iterator it(svg.begin(), svg.end(), word), end; it != end; ++it) {
    const double x = std::stod((*it)[1]), y = std::stod((*it)[2]);
    const double half = 0.5 * Canvas::text_size((*it)[3].str(), 16.0).x();
    boxes.push_back({x - half, y - 7.0, x + half, y + 7.0});
    EXPECT_GT(boxes.back().y1, 30.0);
    EXPECT_LT(boxes.back().x2, 1200.0);
  }
  EXPECT_GT(boxes.size(), 30u);
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      const Box2 &a = boxes[i], &b = boxes[k];
      EXPECT_FALSE(a.x1 < b.x2 && b.x1 < a.x2 && a.y1 < b.y2 && b.y1 < a.y2) << i << " " << k;
    }
  }
  // All right to the last one: the curve ends at 100 %, within its panel.
  const PlotSheet errors = error_plots(scenes, PlottedError::kCenter);
  EXPECT_EQ(errors.panels[1].series[0].y.back(), 100.0);
}

TEST(ResultPlots, DepthOverTimeHasTruthInRedAndMarginsOfOneSigma) {
  const PlotSheet sheet = depth_plots(two_methods(), {{0, 0.0}, {1, 0.1}, {2, 0.2}, {3, 0.3}});
  ASSERT_EQ(sheet.panels.size(), 2u);
  EXPECT_EQ(sheet.panels[0].x.title, "time, s");
  const std::vector<PlotSeries>& series = sheet.panels[0].series;
  ASSERT_EQ(series.size(), 8u);  // for two vehicles: truth; path, points, the truth's last point
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(series[static_cast<std::size_t>(k)].color.red, kTruthRed.red);
    EXPECT_EQ(series[static_cast<std::size_t>(k)].label, "vehicle " + std::to_string(k + 1));
  }
  EXPECT_DOUBLE_EQ(series[1].x[3], 0.3);
  EXPECT_DOUBLE_EQ(series[1].y[3], 23.0);
  EXPECT_DOUBLE_EQ(series[3].y[0], 10.5);
  EXPECT_DOUBLE_EQ(series[3].low[0], 10.5 - 0.25);
  EXPECT_DOUBLE_EQ(series[3].high[0], 10.5 + 0.25);
  EXPECT_TRUE(rim_is_white(draw_plots(sheet)));
  EXPECT_EQ(depth_plots(two_methods(), {}).panels[0].x.title, "frame");
}

TEST(ResultPlots, ProfileBandsAndTimingBars) {
  std::vector<ProfilePoint> profile(5);
  for (int i = 0; i < 5; ++i) {
    ProfilePoint& p = profile[static_cast<std::size_t>(i)];
    p.station = 2.0 * i;
    if (i == 2) continue;  // not covered
    p.height = 0.1 * i;
    p.sigma_height = 0.05;
    p.grade = 0.08;
    p.sigma_grade = 0.01;
  }
  const PlotSheet sheet = profile_plots(profile, true, "hill");
  ASSERT_EQ(sheet.panels.size(), 2u);  // the cross slope is not known
  EXPECT_DOUBLE_EQ(sheet.panels[0].series[0].low[1], 0.1 - 1.96 * 0.05);
  EXPECT_NEAR(sheet.panels[1].series[1].y[3], 8.0, 1e-9);
  EXPECT_NEAR(sheet.panels[1].series[0].high[3], 8.0 + 1.96, 1e-9);
  // Whoever points at a place of a curve reads it, with its band; a gap has no place.
  const std::string hover = plots_svg(sheet);
  EXPECT_THAT(hover, HasSubstr("<title>Height at 2.0 m: 0.100 ± 0.098 m</title>"));
  EXPECT_THAT(hover, HasSubstr("<title>Grade at 6.0 m: 8.00 ± 1.96 %</title>"));
  EXPECT_THAT(hover, Not(HasSubstr("at 4.0 m:")));
  EXPECT_THAT(plots_svg(sheet), Not(HasSubstr("nan")));
  EXPECT_EQ(profile_plots(profile, false, "").panels[0].y.title, "height, units");
  EXPECT_THROW(profile_plots(std::vector<ProfilePoint>(3), true, ""), NoAnswerError);

  Timings timings;
  EXPECT_THROW(timing_plots(timings, ""), NoAnswerError);
  timings.add("load", 12.0);
  timings.add("surface", 234.0);
  const std::string svg = plots_svg(timing_plots(timings, "times"));
  for (const char* word : {"load", "surface", "12 ms", "234 ms", "sum 246 ms"}) {
    EXPECT_THAT(svg, HasSubstr(word));
  }
  EXPECT_TRUE(rim_is_white(draw_plots(timing_plots(timings, "times"))));
}

TEST(ResultPlots, TheEvidenceIsAnIntervalASource) {
  RunDocument run;
  run.scale_sigma = 0.02;
  EXPECT_THROW(evidence_plots(run), NoAnswerError);
  const auto evidence = [](const char* name, const char* cause, nlohmann::json log_scale,
                           nlohmann::json sigma) {
    return nlohmann::json{
        {"name", name}, {"cause", cause}, {"log_scale", log_scale}, {"sigma", sigma}};
  };
  run.extra["evidence"] = {evidence("camera_height", "height", 0.1, 0.05),
                           evidence("road_layer", "layer", 0.0, nullptr),
                           evidence("focal_length", "focal_length", 0.7, 0.1), "no evidence",
                           evidence("road_width", "markings", 0.1, 2.0)};
  const Plot plot = evidence_plots(run).panels.at(0);
  ASSERT_EQ(plot.y.names.size(), 2u);
  EXPECT_EQ(plot.y.names[0].second, "camera height");
  EXPECT_EQ(plot.y.names[1].second, "the result");
  EXPECT_NEAR(plot.series[0].x[0], 100.0 * std::expm1(0.05), 1e-9);
  EXPECT_NEAR(plot.series[0].right[0], 100.0 * std::expm1(0.15), 1e-9);
  EXPECT_NEAR(plot.series[1].x[1], 0.0, 1e-9);
  EXPECT_TRUE(rim_is_white(draw_plots(evidence_plots(run))));
}

/// Two results of the scene, the second placing all vehicles 6 m too near.
struct ComparedResults {
  test::PictureScene scene;
  LoadedResult good, bad;

  ComparedResults() {
    good.scene.emplace();
    good.scene->name = "hill";
    good.scene->camera = scene.camera;
    good.scene->height_above_road = 1.65;
    good.scene->truth = scene.truth;
    for (TruthVehicle& t : good.scene->truth->frames[0].vehicles) {
      t.box = {100.0 * t.id, 100.0, 100.0 * t.id + 60.0, 150.0};
    }
    for (VehicleEstimate& v : scene.vehicles.frames[0].vehicles) {
      v.box = {100.0 * v.id, 100.0, 100.0 * v.id + 60.0, 150.0};
    }
    good.vehicles = bad.vehicles = scene.vehicles;
    good.run = bad.run = scene.run;
    good.surface = scene.surface;
    bad.vehicles->method = "flat";
    for (VehicleEstimate& v : bad.vehicles->frames[0].vehicles) {
      const Eigen::Vector3d shift(0.0, 0.0, -6.0 - v.id);
      v.pose.camera_from_vehicle.set_translation(v.pose.bottom_center() + shift);
      for (Eigen::Vector3d& x : v.keypoints) x += shift;
    }
  }
};

TEST(VehicleComparison, ShowsAVehicleAsEachResultPlacesIt) {
  const ComparedResults c;
  const PlotSheet sheet = vehicle_comparison({&c.good, &c.bad}, 7, 1);
  EXPECT_THAT(sheet.title, HasSubstr("vehicle 1"));
  ASSERT_EQ(sheet.panels.size(), 2u);
  // The truth is 0.5 m to the right and 1 m behind the estimate (picture_content.h).
  const std::string svg = plots_svg(sheet);
  EXPECT_THAT(svg, HasSubstr("joint: centre 1.12 m off"));
  EXPECT_THAT(svg, HasSubstr("flat: centre 8.02 m off"));  // (0.5, 0, 8)
  const auto series = [&](std::size_t panel, const Color& color) {
    for (const PlotSeries& s : sheet.panels[panel].series) {
      if (s.color.red == color.red && s.color.green == color.green) return s;
    }
    ADD_FAILURE();
    return PlotSeries{};
  };
  const auto range = [](const std::vector<double>& values) {
    double low = 1e9, high = -1e9;
    for (const double v : values) {
      if (!std::isfinite(v)) continue;
      low = std::min(low, v);
      high = std::max(high, v);
    }
    return std::pair{low, high};
  };
  // The true box: 4.4 m long, away from the camera, from 12.8 to 17.2 m ahead of the camera of
  // frame 7, which is the reference; its bottom on y = 0.53, 1.65 - 0.53 m over the near road.
  const auto ahead = range(series(0, kTruthRed).x), up = range(series(0, kTruthRed).y);
  EXPECT_NEAR(ahead.first, 12.8, 1e-6);
  EXPECT_NEAR(ahead.second, 17.2, 1e-6);
  EXPECT_NEAR(up.first, 1.65 - test::PictureScene::road_y(14.0), 1e-6);
  EXPECT_NEAR(up.second - up.first, 1.5, 1e-6);
  const auto left = range(series(1, kTruthRed).y);
  EXPECT_NEAR(left.first, 1.5 - 0.9, 1e-6);  // 1.5 m to the left
  EXPECT_NEAR(left.second, 1.5 + 0.9, 1e-6);
  // The wireframes' middles.
  const auto joint = range(series(0, plot_color(0)).x), flat = range(series(0, plot_color(1)).x);
  EXPECT_NEAR(joint.first - flat.first, 7.0, 1e-6);
  EXPECT_TRUE(rim_is_white(draw_plots(sheet, {1600, 420, 22.0})));

  // Without an id the one that differs most, number 2.
  EXPECT_THAT(vehicle_comparison({&c.good, &c.bad}, 7, {}).title, HasSubstr("vehicle 2"));
}

TEST(VehicleComparison, SaysWhatIsMissing) {
  ComparedResults c;
  EXPECT_THROW(vehicle_comparison({&c.good, &c.bad}, 7, 99), NoAnswerError);
  EXPECT_THROW(vehicle_comparison({&c.good, &c.bad}, 8, {}), NoAnswerError);
  EXPECT_THROW(vehicle_comparison({&c.bad, &c.good}, 7, {}), NoAnswerError);  // no scene
  EXPECT_THROW(vehicle_comparison({}, 7, {}), std::invalid_argument);
  c.bad.vehicles->frames[0].vehicles[0].status = Status::kFailed;
  EXPECT_THROW(vehicle_comparison({&c.good, &c.bad}, 7, 1), NoAnswerError);
  c.bad.vehicles.reset();
  EXPECT_THROW(vehicle_comparison({&c.good, &c.bad}, 7, {}), NoAnswerError);
}

}  // namespace
}  // namespace camber
