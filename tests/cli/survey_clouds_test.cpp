// camber info on LAS and text files of other programs: every value that independent parsers found.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "camber/core/random.h"
#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;
namespace fs = std::filesystem;

/// Collects what differs, one line each.
struct Comparison {
  std::string differences;

  void differ(const std::string& what, const json& expected, const json& found) {
    differences += "  " + what + ": expected " + expected.dump().substr(0, 200) + ", found " +
                   found.dump(-1, ' ', false, json::error_handler_t::replace).substr(0, 200) + "\n";
  }
  void equal(const std::string& what, const json& expected, const json& found) {
    if (expected != found) differ(what, expected, found);
  }
  /// Numbers, or arrays of them; null stands for a value that is not there.
  void near(const std::string& what, const json& expected, const json& found, double tolerance) {
    if (expected.is_array()) {
      if (!found.is_array() || found.size() != expected.size())
        return differ(what, expected, found);
      for (std::size_t i = 0; i < expected.size(); ++i) {
        near(what + "[" + std::to_string(i) + "]", expected[i], found[i], tolerance);
      }
      return;
    }
    if (expected.is_null() != found.is_null()) return differ(what, expected, found);
    if (expected.is_null()) return;
    if (!found.is_number()) return differ(what, expected, found);
    const double e = expected.get<double>(), f = found.get<double>();
    // A double's own resolution comes on top: random bytes make times of 1e305.
    if (!(std::abs(e - f) <= tolerance + 1e-15 * std::abs(e))) differ(what, expected, found);
  }
};

json attribute(const json& info, const std::string& name) {
  for (const json& a : info.at("attributes")) {
    if (a.at("name") == name) return a;
  }
  // Text files have X as well as x.
  for (const json& a : info.at("attributes")) {
    if (name.size() == 1 && a.at("name") == std::string(1, static_cast<char>(name[0] - 32)))
      return a;
  }
  return nullptr;
}

json range(const json& attribute) {
  return attribute.is_null() ? json(nullptr) : json{attribute.at("min"), attribute.at("max")};
}

/// One of the points with all its fields.
void compare_point(Comparison& c, const std::string& which, const json& expected, const json& info,
                   double step) {
  const json found = info.value(which, json::object());
  const auto value = [&](const char* name) { return found.value(name, json(nullptr)); };
  static const std::pair<const char*, const char*> kNames[] = {
      {"intensity", "intensity"},  {"return", "return_number"}, {"returns", "number_of_returns"},
      {"class", "classification"}, {"gps_time", "gps_time"},    {"nir", "nir"}};
  std::set<std::string> known = {"x", "y", "z", "rgb", "extra"};
  for (const char* axis : {"x", "y", "z"}) {
    c.near(which + "." + axis, expected.at(axis), value(axis), step);
  }
  for (const auto& [theirs, ours] : kNames) {
    known.insert(theirs);
    if (expected.contains(theirs)) c.near(which + "." + theirs, expected[theirs], value(ours), 0);
  }
  if (expected.contains("rgb")) {
    c.equal(which + ".rgb", expected["rgb"], json{value("red"), value("green"), value("blue")});
  }
  const json extras = expected.value("extra", json::object());
  for (const auto& [name, raw] : extras.items()) {
    double scale = 1.0;
    for (const json& extra : info.at("las").at("extra_bytes")) {
      if (extra.at("name") == name) scale = extra.value("scale", 1.0);
    }
    c.near(which + "." + name, raw.get<double>() * scale, value(name.c_str()), 1e-9);
  }
  for (const auto& [key, unused] : expected.items()) {
    if (known.count(key) == 0) c.differ(which + "." + key, "a comparison", nullptr);
  }
}

/// Values of expected.json that stand under the same name in the object "las".
void compare_las_header(Comparison& c, const json& expected, const json& las) {
  for (const char* key : {"bytes",
                          "version",
                          "file_source_id",
                          "global_encoding",
                          "system_identifier",
                          "generating_software",
                          "creation",
                          "header_size",
                          "offset_to_points",
                          "vlr_count",
                          "compressed",
                          "point_format",
                          "record_length",
                          "legacy_point_count",
                          "scale",
                          "offset",
                          "header_max",
                          "header_min",
                          "point_count",
                          "points_by_return",
                          "gap_before_points",
                          "vlrs",
                          "evlrs",
                          "extra_bytes_per_point",
                          "points_present",
                          "flags"}) {
    if (expected.contains(key)) c.equal(key, expected[key], las.value(key, json(nullptr)));
  }
  c.equal("extra_bytes.size", expected["extra_bytes"].size(), las["extra_bytes"].size());
  for (std::size_t i = 0; i < expected["extra_bytes"].size() && i < las["extra_bytes"].size();
       ++i) {
    for (const auto& [key, value] : expected["extra_bytes"][i].items()) {
      c.equal("extra_bytes." + key, value, las["extra_bytes"][i].value(key, json(nullptr)));
    }
  }
}

void compare_las(Comparison& c, const json& expected, const json& info) {
  const json& las = info.at("las");
  compare_las_header(c, expected, las);
  c.equal("points", expected.value("points_present", 0), info["points"]);
  const json crs = info["crs"].is_null() ? json::object() : info["crs"];
  const json& expected_crs = expected["crs"];
  const bool own = crs.value("wkt_source", "file") == "file";
  c.equal("wkt", expected_crs.value("wkt", json(nullptr)),
          own ? crs.value("wkt", json(nullptr)) : json(nullptr));
  c.equal("geotiff_keys", expected_crs.value("geotiff_keys", json(nullptr)),
          crs.value("geotiff_keys", json(nullptr)));
  c.equal("wkt_bit", expected_crs["wkt_bit"], (las["global_encoding"].get<int>() & 16) != 0);
  double step = 0.0;  // the README: bounds to a hundredth of the scale
  for (const json& s : expected["scale"]) step = std::max(step, std::abs(s.get<double>()) / 100);
  if (!expected["bounds"].is_null()) {
    c.near("bounds.min", expected["bounds"]["min"], info["bounds"]["min"], step);
    c.near("bounds.max", expected["bounds"]["max"], info["bounds"]["max"], step);
  }
  if (expected.contains("mean")) c.near("mean", expected["mean"], info["mean"], step);
  if (expected.contains("first_point")) {
    compare_point(c, "first_point", expected["first_point"], info, step);
    compare_point(c, "last_point", expected["last_point"], info, step);
  }
  const auto compare_range = [&](const char* key, const char* name) {
    if (expected.contains(key)) c.near(key, expected[key], range(attribute(info, name)), 0);
  };
  compare_range("intensity_range", "intensity");
  compare_range("gps_time_range", "gps_time");
  const auto counts = [&](const char* key, const char* name) {
    if (!expected.contains(key)) return;
    const json a = attribute(info, name);
    c.equal(key, expected[key], a.is_null() ? a : a.value("counts", json::object()));
  };
  counts("classes", "classification");
  counts("returns", "return_number");
  if (expected.contains("rgb_max")) {
    c.equal("rgb_max", expected["rgb_max"],
            json{attribute(info, "red").at("max"), attribute(info, "green").at("max"),
                 attribute(info, "blue").at("max")});
  }
  if (expected.contains("nir_max")) {
    c.equal("nir_max", expected["nir_max"], attribute(info, "nir").at("max"));
  }
  const json ranges = expected.value("extra_bytes_range_scaled", json::object());
  for (const auto& [name, limits] : ranges.items()) {
    c.near(name, limits, range(attribute(info, name)), 1e-9);
  }
  // Contradictions that a reader would stumble over are told.
  for (const json& issue : expected["issues"]) {
    const std::string text = issue;
    const char* wanted = text.find("legacy") != std::string::npos        ? "older count"
                         : text.find("extra bytes") != std::string::npos ? "extra bytes"
                         : text.find("by return") != std::string::npos   ? "by return"
                                                                         : nullptr;
    // "header size 393, version 1.5 has None" is none: 393 bytes are what version 1.5 has.
    if (wanted && las["contradictions"].dump().find(wanted) == std::string::npos) {
      c.differ("issues", issue, las["contradictions"]);
    }
  }
}

void compare_text(Comparison& c, const json& expected, const json& info) {
  const json& text = info.at("text");
  c.equal("points", expected["points"], info["points"]);
  for (const char* key : {"header_lines", "header", "separator", "columns", "x_y_z_columns",
                          "line_ends", "decimal_sign", "count_line"}) {
    if (expected.contains(key)) c.equal(key, expected[key], text.value(key, json(nullptr)));
  }
  c.equal("missing", expected.value("missing", 0), info["non_finite"]);
  for (int axis = 0; axis < 3; ++axis) {
    const std::string name(1, "xyz"[axis]);
    const std::size_t a = static_cast<std::size_t>(axis);
    c.near("bounds_" + name, expected["bounds_" + name], range(attribute(info, name)), 1e-9);
    const std::string theirs = attribute(info, name).at("name");
    c.near("first", expected["first"][a], info["first_point"][theirs], 1e-9);
    c.near("last", expected["last"][a], info["last_point"][theirs], 1e-9);
  }
  if (expected.contains("scan")) c.equal("scan", expected["scan"], text.at("scans").at(0));
  if (expected.contains("points_at_0_0_0")) {
    c.equal("points_at_0_0_0", expected["points_at_0_0_0"],
            text["scans"][0]["columns"].get<int>() * text["scans"][0]["rows"].get<int>() -
                info["points"].get<int>());
  }
}

/// What differs for each file of a folder; files without a difference are left out.
std::string compare_folder(const char* folder, std::size_t* files, std::size_t* right) {
  const fs::path path = test::data_dir() / "format-files" / folder;
  const json expected = json::parse(test::read_text(path / "expected.json"));
  std::string out;
  for (const auto& [name, values] : expected.items()) {
    ++*files;
    const test::ProgramResult result = run_camber({"info", (path / name).string(), "--json"});
    Comparison c;
    if (result.exit_code != 0) {
      c.differences = "  " + result.error;
    } else {
      const json info = json::parse(result.out).at("files").at(0);
      try {
        if (std::string(folder) == "las") {
          compare_las(c, values, info);
        } else {
          compare_text(c, values, info);
        }
      } catch (const json::exception& error) {
        c.differences += std::string("  ") + error.what() + "\n";
      }
    }
    if (c.differences.empty()) ++*right;
    if (!c.differences.empty()) out += name + "\n" + c.differences;
  }
  return out;
}

TEST(SurveyClouds, EveryExpectedValueOfLasFiles) {
  CAMBER_REQUIRE_DATA("format-files/las");
  std::size_t files = 0, right = 0;
  EXPECT_EQ(compare_folder("las", &files, &right), "");
  EXPECT_EQ(files, 23u);
  RecordProperty("files_right", static_cast<int>(right));
}

TEST(SurveyClouds, EveryExpectedValueOfTextClouds) {
  CAMBER_REQUIRE_DATA("format-files/text-clouds");
  std::size_t files = 0, right = 0;
  EXPECT_EQ(compare_folder("text-clouds", &files, &right), "");
  EXPECT_EQ(files, 14u);
  RecordProperty("files_right", static_cast<int>(right));
}

class SurveyTools : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  void write_text(const std::string& name, const std::string& text) const {
    std::ofstream(path(name)) << text;
  }
  test::ProgramResult run(const std::vector<std::string>& arguments) const {
    test::ProgramResult result = run_camber(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return result;
  }
  json run_json(std::vector<std::string> arguments) const {
    arguments.push_back("--json");
    return json::parse(run(arguments).out);
  }
  /// A street with a wall beside it, all coordinates times `factor`, classes in their turn.
  std::string street(double factor) const {
    std::ostringstream out;
    out.precision(12);
    out << "x,y,z,classification,intensity,scan_angle\n";
    const CounterRandom random(7);
    const auto digits = [](double v) { return std::round(v * 1000.0) / 1000.0; };
    for (std::uint64_t i = 0; i < 12000; ++i) {
      const double x = digits(random.uniform(4 * i, -20, 20));
      const double y = digits(random.uniform(4 * i + 1, -20, 20));
      const bool wall = i % 5 == 0;
      const double z = wall ? digits(random.uniform(4 * i + 2, 0.5, 5))
                            : digits(0.02 * x + 0.01 * random.normal(i));
      const int classes[] = {0, 1, 2, 6, 7, 9};
      out << factor * x << ',' << factor * (wall ? digits(15 + 0.01 * y) : y) << ',' << factor * z
          << ',' << classes[i % 6] << ',' << i % 1000 << ",0.5\n";
    }
    return out.str();
  }
  static std::string records(const std::string& bytes) {
    std::uint32_t start = 0;
    std::memcpy(&start, bytes.data() + 96, 4);
    return bytes.substr(start);
  }
  static std::size_t record_length(const std::string& bytes) {
    std::uint16_t length = 0;
    std::memcpy(&length, bytes.data() + 105, 2);
    return length;
  }

  test::TemporaryFolder folder_;
};

TEST_F(SurveyTools, CloudsOfOtherSystemsAreNotComparedInSilence) {
  write_text("street.csv", street(1.0));
  run({"convert", path("street.csv"), "--crs", "EPSG:32632", "--out", path("a.las")});
  run({"convert", path("street.csv"), "--crs", "EPSG:32633", "--out", path("b.las")});
  const auto warning = [&](const std::string& truth) {
    const auto result = run_camber({"compare", path("a.las"), path(truth), "--no-road-frame"});
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return result.error;
  };
  EXPECT_THAT(warning("b.las"), testing::HasSubstr("EPSG:32633, metre: they are compared as they"));
  EXPECT_EQ(warning("a.las"), "");
}

TEST_F(SurveyTools, LasThroughConvertAndFilterKeepsItsRecords) {
  write_text("street.csv", street(1.0));
  write_text("system.wkt", "PROJCS[\"mine\",UNIT[\"metre\",1]]");
  run({"convert", path("street.csv"), "--crs", path("system.wkt"), "--out", path("a.las")});
  run({"convert", path("a.las"), "--out", path("b.las")});
  const std::string a = test::read_text(path("a.las"));
  EXPECT_TRUE(a == test::read_text(path("b.las")));
  const json info = run_json({"info", path("b.las")})["files"][0];
  EXPECT_EQ(info["crs"]["name"], "mine");
  EXPECT_EQ(info["metric"], true);

  // In memory and sorted: the same records in another order.
  run({"filter", path("a.las"), "--radius", "3,1", "--morton", "--out", path("c.las")});
  const std::string c = test::read_text(path("c.las"));
  ASSERT_EQ(record_length(c), record_length(a));
  const auto rows = [&](const std::string& bytes) {
    std::multiset<std::string> all;
    const std::string body = records(bytes);
    for (std::size_t at = 0; at < body.size(); at += record_length(bytes)) {
      all.insert(body.substr(at, record_length(bytes)));
    }
    return all;
  };
  EXPECT_EQ(rows(c), rows(a));
  EXPECT_FALSE(records(c) == records(a));
  // Normals come behind the records as they are.
  run({"filter", path("a.las"), "--normals", "10", "--out", path("n.las")});
  const std::string n = test::read_text(path("n.las"));
  ASSERT_EQ(record_length(n), record_length(a) + 12);
  EXPECT_EQ(records(n).substr(0, record_length(a)), records(a).substr(0, record_length(a)));
  // Means are made anew, with the coordinate system.
  run({"filter", path("a.las"), "--voxel", "2", "--out", path("v.las")});
  EXPECT_EQ(run_json({"info", path("v.las")})["files"][0]["crs"]["name"], "mine");
}

TEST_F(SurveyTools, WellKnownTextOfASystemStatedByItsCode) {
  // Of point formats below 6.
  write_text("plain.csv", "x,y,z\n500000,4100000,3\n500004,4100005,6\n");
  const auto stated = [&](const std::string& crs) {
    run({"convert", path("plain.csv"), "--crs", crs, "--out", path("coded.las")});
    return run_json({"info", path("coded.las")})["files"][0]["crs"];
  };
  // Codes go to GeoTIFF keys.
  const json coded = stated("EPSG:26917");
  EXPECT_TRUE(coded.contains("geotiff_keys"));
  EXPECT_EQ(coded["epsg"], 26917);
  EXPECT_EQ(coded.value("wkt_source", ""), "epsg");
  const std::string wkt = coded.value("wkt", "");
  EXPECT_EQ(wkt.rfind("PROJCS[\"NAD83 / UTM zone 17N\"", 0), 0u) << wkt;
  EXPECT_EQ(stated("PROJCS[\"mine\",UNIT[\"metre\",1]]").value("wkt_source", ""), "file");
  const json given = run_json({"info", path("coded.las"), "--crs", "EPSG:32632"});
  EXPECT_EQ(given["files"][0]["crs"].value("wkt_source", ""), "option");
}

TEST_F(SurveyTools, GroundOfFeetIsThatOfMetres) {
  // A unit of half a metre: coordinates twice as large, exactly.
  write_text("metres.csv", street(1.0));
  write_text("halves.csv", street(2.0));
  write_text("halves.wkt", "PROJCS[\"halves\",UNIT[\"half a metre\",0.5]]");
  run({"convert", path("metres.csv"), "--out", path("metres.las")});
  run({"convert", path("halves.csv"), "--crs", path("halves.wkt"), "--out", path("halves.las")});
  const json info = run_json({"info", path("halves.las")})["files"][0];
  EXPECT_EQ(info["metric"], false);
  EXPECT_EQ(info["crs"]["unit"]["metres"], 0.5);
  for (const char* name : {"metres", "halves"}) {
    const test::ProgramResult ground =
        run({"ground", path(std::string(name) + ".las"), "--out",
             path(std::string(name) + "-ground.las"), "--keep-classes", "6,7"});
    EXPECT_EQ(ground.error.find("half a metre") != std::string::npos, std::string(name) == "halves")
        << ground.error;
  }
  const std::string before = records(test::read_text(path("metres.las")));
  const std::string metres = records(test::read_text(path("metres-ground.las")));
  const std::string halves = records(test::read_text(path("halves-ground.las")));
  const std::size_t length = record_length(test::read_text(path("metres.las")));
  ASSERT_EQ(metres.size(), before.size());
  ASSERT_EQ(halves.size(), before.size());
  int ground = 0, unclassified = 0;
  for (std::size_t at = 0; at < before.size(); at += length) {
    const char was = before[at + 16], is = metres[at + 16];
    EXPECT_EQ(is, halves[at + 16]);
    if (was == 6 || was == 7) {
      EXPECT_EQ(is, was);
    } else if (is == 2) {
      ++ground;
    } else {
      EXPECT_EQ(is, was == 9 ? 9 : 1);
      ++unclassified;
    }
    EXPECT_EQ(metres.substr(at, 16), before.substr(at, 16));
    EXPECT_EQ(metres.substr(at + 17, length - 17), before.substr(at + 17, length - 17));
  }
  EXPECT_GT(ground, 5000);
  EXPECT_GT(unclassified, 500);

  // Planes come out in metres, equal; thresholds are metres.
  json planes[2];
  for (int k = 0; k < 2; ++k) {
    planes[k] =
        run_json({"plane", path(k == 0 ? "metres.las" : "halves.las"), "--threshold", "0.05"});
    EXPECT_EQ(planes[k]["metric"], true);
  }
  EXPECT_EQ(planes[0]["plane"], planes[1]["plane"]);
  // A radius of metres finds as many neighbours.
  for (const char* name : {"metres", "halves"}) {
    run({"filter", path(std::string(name) + ".las"), "--radius", "0.2,3", "--out",
         path(std::string(name) + "-thin.las")});
  }
  EXPECT_EQ(
      test::read_text(path("metres-thin.las")).size() - test::read_text(path("metres.las")).size(),
      test::read_text(path("halves-thin.las")).size() - test::read_text(path("halves.las")).size());
}

TEST_F(SurveyTools, FeetOfAColumnsNameStayFeetInEveryFormat) {
  std::string feet = street(1.0 / 0.3048);
  feet.replace(0, 5, "x_ft,y_ft,z_ft");
  write_text("feet.csv", feet);
  const json expected = run_json({"plane", path("feet.csv"), "--threshold", "0.05"});
  for (const char* name : {"feet.las", "feet.ply", "feet.pcd", "feet.xyz"}) {
    run({"convert", path("feet.csv"), "--out", path(name)});
    run({"ground", path("feet.csv"), "--out", path(std::string("ground-") + name)});
    for (const std::string& file : {std::string(name), std::string("ground-") + name}) {
      const json info = run_json({"info", path(file)})["files"][0];
      EXPECT_EQ(info["metric"], false) << file;
      EXPECT_EQ(info["crs"]["unit"]["name"], "foot") << file;
      EXPECT_EQ(info["crs"]["vertical_unit"]["name"], "foot") << file;
      const test::ProgramResult plane = run({"plane", path(file), "--threshold", "0.05", "--json"});
      EXPECT_THAT(plane.error, ::testing::HasSubstr("in units of foot")) << file;
      const json found = json::parse(plane.out);
      EXPECT_EQ(found["metric"], true) << file;
      EXPECT_NEAR(found["plane"]["offset"].get<double>(), expected["plane"]["offset"].get<double>(),
                  1e-3)
          << file;
    }
  }
  // Written anew from LAS.
  run({"filter", path("feet.las"), "--voxel", "0.5", "--out", path("thin.las")});
  EXPECT_EQ(run_json({"info", path("thin.las")})["files"][0]["crs"]["unit"]["name"], "foot");
}

TEST_F(SurveyTools, SystemsByCodeAndDegrees) {
  write_text("feet.csv", "x,y,z\n1,2,3\n4,5,6\n7,1,9\n");
  const json feet = run_json({"info", path("feet.csv"), "--crs", "EPSG:2994"})["files"][0];
  EXPECT_EQ(feet["crs"]["unit"]["name"], "foot");
  EXPECT_EQ(feet["metric"], false);
  EXPECT_EQ(run_json({"info", path("feet.csv"), "--crs",
                      "+proj=utm +zone=17 +datum=WGS84"})["files"][0]["crs"]["kind"],
            "projected");
  EXPECT_ONE_SENTENCE(run_camber({"info", path("feet.csv"), "--crs", "EPSG:999999"}), 2, "--crs");
  // A PROJ that finds no system at all, as it does without memory: not the option's fault.
  test::Surroundings no_database;
  no_database.variables = {"PROJ_DATA=" + path(""), "PROJ_LIB=" + path("")};
  EXPECT_ONE_SENTENCE(
      test::run_camber_in(no_database, {"info", path("feet.csv"), "--crs", "EPSG:2994"}), 3,
      "PROJ finds no system");
  write_text("true.csv", "x,y,z\n1,2,3\n4,5,6\n7,1,9\n");
  const test::ProgramResult drawn =
      run_camber({"render", path("feet.csv"), "--crs", "EPSG:2994", "--truth", path("true.csv"),
                  "--view", "bev", "--out", path("feet.png")});
  ASSERT_EQ(drawn.exit_code, 0) << drawn.error;
  for (const char* name : {"feet.csv", "true.csv"}) {
    EXPECT_THAT(drawn.error,
                ::testing::HasSubstr(path(name) + ": the coordinates are in units of foot"));
  }
  write_text("degrees.csv", "lon,lat,height\n10,50,3\n10.1,50,6\n10,50.1,9\n10.1,50.1,8\n");
  const test::ProgramResult degrees =
      run_camber({"plane", path("degrees.csv"), "--threshold", "5"});
  EXPECT_THAT(degrees.error, ::testing::HasSubstr("longitude and latitude"));
  // The names of columns are no datum.
  const std::string loss = "has no place in the output without their coordinate system";
  EXPECT_THAT(run({"convert", path("degrees.csv"), "--out", path("degrees.las")}).error,
              ::testing::HasSubstr(loss));
  EXPECT_THAT(
      run({"convert", path("degrees.csv"), "--crs", "EPSG:4326", "--out", path("degrees.las")})
          .error,
      ::testing::Not(::testing::HasSubstr(loss)));
  // A code whose kind PROJ alone knows: NTF.
  write_text("code.csv", "# camber crs EPSG:4275\nx,y,z\n2.123456789,48.123456789,3\n2.2,48.2,4\n");
  for (const char* command : {"convert", "filter"}) {
    run({command, path("code.csv"), "--out", path("code.las")});
    const json info = run_json({"info", path("code.las")})["files"][0];
    EXPECT_EQ(info["crs"]["kind"], "geographic");
    EXPECT_EQ(info["crs"]["geotiff_keys"]["GTModelType"], 2);
    EXPECT_EQ(info["las"]["scale"][0], 1e-9);
    EXPECT_EQ(info["las"]["scale"][2], 1e-4);
    EXPECT_NEAR(info["first_point"]["x"].get<double>(), 2.123456789, 0.6e-9);
  }
  // A LAS file that names a code and no unit.
  run({"convert", path("feet.csv"), "--crs", "EPSG:2994", "--out", path("feet.las")});
  std::string bytes = test::read_text(path("feet.las"));
  const std::size_t unit = bytes.find(std::string("\x04\x0c\0\0\1\0\x2a\x23", 8));
  ASSERT_NE(unit, std::string::npos);                                  // key 3076: 9002
  bytes.replace(unit, 8, std::string("\x04\x0c\0\0\1\0\xff\x7f", 8));  // user-defined
  std::ofstream(path("code.las"), std::ios::binary) << bytes;
  EXPECT_EQ(run_json({"info", path("code.las")})["files"][0]["crs"]["unit"]["name"], "foot");
}

TEST_F(SurveyTools, PatchesGiveTheirInputBackAsLas) {
  write_text("street.csv", street(1.0));
  run({"convert", path("street.csv"), "--out", path("street.las")});
  run({"patches", path("street.las"), "--las", "--out", path("result")});
  const std::string before = test::read_text(path("street.las"));
  const std::string after = test::read_text(folder_.path() / "result/labels.las");
  ASSERT_EQ(record_length(after), record_length(before) + 4);
  EXPECT_EQ(records(after).substr(0, record_length(before)),
            records(before).substr(0, record_length(before)));
  const json info = run_json({"info", (folder_.path() / "result/labels.las").string()})["files"][0];
  EXPECT_FALSE(attribute(info, "patch").is_null());
}

TEST_F(SurveyTools, MapCoordinatesAsBinAreShifted) {
  write_text("map.csv", "x,y,z\n405138.57,3276459.77,38.69\n405130.22,3276428.38,39.32\n");
  const test::ProgramResult result = run({"convert", path("map.csv"), "--out", path("map.bin")});
  EXPECT_THAT(result.error, ::testing::HasSubstr("relative to 405000 3276000 0"));
  const json info = run_json({"info", path("map.bin")})["files"][0];
  EXPECT_NEAR(info["bounds"]["max"][0].get<double>(), 138.57, 1e-4);
  EXPECT_NEAR(info["bounds"]["max"][1].get<double>(), 459.77, 1e-4);
}

}  // namespace
}  // namespace camber
