// OpenDRIVE files as inputs, drives as outputs, boxes of data sets: the built program.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "export_program.h"
#include "support/feather_writer.h"

namespace camber {
namespace {

using nlohmann::json;
using test::ExportProgram;
using test::run_camber;
using ::testing::HasSubstr;

class RoadFiles : public ExportProgram {
 protected:
  json json_of(const std::vector<std::string>& command) {
    const auto result = run_camber(command);
    EXPECT_EQ(result.exit_code, 0) << command[0] << ": " << result.error;
    return result.exit_code == 0 ? json::parse(result.out) : json();
  }
};

TEST_F(RoadFiles, OpenDriveIsShownMeasuredAndCompared) {
  ASSERT_EQ(
      run_camber({"export", file("surface.json"), "--to", "opendrive", "--out", file("road.xodr")})
          .exit_code,
      0);
  const json info = json_of({"info", file("road.xodr"), "--json"})["files"][0];
  EXPECT_EQ(info["kind"], "opendrive");
  EXPECT_EQ(info["rev"], "1.7");
  EXPECT_TRUE(info["geo_reference"].is_null());
  const json profile = json_of({"profile", file("road.xodr"), "--step", "2", "--json"});
  EXPECT_NEAR(profile["length"].get<double>(), info["total_length"].get<double>(), 1e-9);
  // The surface climbs by 5 %, then 10 %, and is banked by 2 %.
  const json& at = profile["stations"][4];
  EXPECT_NEAR(at["grade_percent"].get<double>(), 5.0, 0.3);
  EXPECT_NEAR(std::abs(at["superelevation_percent"].get<double>()), 2.0, 0.1);
  // 7 m of patches, and --reach beyond either side.
  EXPECT_NEAR(at["width_left"].get<double>() + at["width_right"].get<double>(), 8.0, 0.1);
  const json compared = json_of({"compare", file("road.xodr"), file("road.xodr"), "--json"});
  EXPECT_LT(compared["accuracy"]["rms"].get<double>(), 0.001);
  EXPECT_ONE_SENTENCE(run_camber({"profile", file("road.xodr"), "--road", "77", "--json"}), 2,
                      "found '77'");
  EXPECT_ONE_SENTENCE(run_camber({"profile", file("road.xodr"), "--reach", "2", "--json"}), 2,
                      "OpenDRIVE file");
  EXPECT_ONE_SENTENCE(run_camber({"profile", file("surface.json"), "--road", "1", "--json"}), 2,
                      "--road");
}

TEST_F(RoadFiles, FilesOfOthersAreMeasured) {
  CAMBER_REQUIRE_DATA("format-files/opendrive/crest-curve.xodr");
  const std::string crest = (test::data_dir() / "format-files/opendrive/crest-curve.xodr").string();
  ASSERT_EQ(run_camber({"profile", crest, "--step", "10", "--out", file("crest.csv")}).exit_code,
            0);
  // The crest is 6 m high at 270 m, where its records meet.
  std::istringstream lines(test::read_text(file("crest.csv")));
  bool found = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("270.000,", 0) != 0) continue;
    found = true;
    EXPECT_THAT(line, HasSubstr(",6.00000,"));
  }
  EXPECT_TRUE(found);
}

TEST_F(RoadFiles, ADriveIsExportedFromItsFirstFrameToItsLast) {
  const std::string scene = (test::source_dir() / "samples/steep_hill").string();
  ASSERT_EQ(run_camber({"drive", scene, "--no-pictures", "--out", file("drive")}).exit_code, 0);
  const json counts = json_of(
      {"export", file("drive"), "--to", "mcap", "--out", file("a.mcap"), "--json"})["messages"];
  const json index = json::parse(test::read_text(file("drive/strip/index.json")));
  EXPECT_EQ(counts["/road/points"], index["stretches"].size());
  for (const char* topic : {"/tf", "/camera/image", "/camera/calibration", "/vehicles"}) {
    EXPECT_EQ(counts[topic], 3) << topic;
  }
  // Parked tracks of all frames, each once; those that move have no one place.
  std::ofstream(file("line.csv")) << "x,y,z\n0,1.65,5\n0,1.65,20\n";
  const json cars = json_of({"export", file("drive"), "--along", file("line.csv"), "--to",
                             "opendrive", "--vehicles", "--out", file("cars.xodr"), "--json"});
  const json tracks = json::parse(test::read_text(file("drive/tracks.json")))["tracks"];
  std::size_t parked = 0;
  for (const json& track : tracks) {
    if (track["motion"] != "parked") continue;
    ++parked;
    EXPECT_THAT(test::read_text(file("cars.xodr")),
                HasSubstr("name=\"" + track["class"].get<std::string>() + " " +
                          std::to_string(track["id"].get<int>()) + "\""));
  }
  EXPECT_GT(parked, 0u);
  EXPECT_EQ(cars["vehicles"], parked);
  EXPECT_EQ(cars["moving_left_out"], tracks.size() - parked);
}

TEST_F(RoadFiles, BoxesOfDataSetsAreLifted) {
  // A cloud of a hill of 10 %, and two boxes of Argoverse 2 in the frame of a vehicle on it.
  std::ofstream cloud(file("hill.csv"));
  cloud << "x,y,z\n";
  for (int i = 0; i < 200; ++i) {
    for (int k = 0; k < 80; ++k) {
      cloud << 0.2 * i << "," << 0.2 * k - 8.0 << "," << 0.02 * i << "\n";
    }
  }
  cloud.close();
  std::ofstream(file("boxes.csv"))
      << "timestamp_ns,category,length_m,width_m,height_m,qw,qx,qy,qz,tx_m,ty_m,tz_m\n"
         "5,CAR,4,1.8,1.5,1,0,0,0,10,0,0.9\n5,CAR,4,1.8,1.5,1,0,0,0,500,0,0.9\n";
  std::ofstream(file("poses.csv")) << "timestamp_ns,qw,qx,qy,qz,tx_m,ty_m,tz_m\n5,1,0,0,0,10,0,1\n";
  const json lifted = json_of({"lift", file("boxes.csv"), "--surface", file("hill.csv"), "--poses",
                               file("poses.csv"), "--out", file("lifted.csv"), "--json"});
  EXPECT_EQ(lifted["form"], "argoverse2");
  EXPECT_EQ(lifted["boxes"], 2);
  EXPECT_EQ(lifted["lifted"], 1);
  EXPECT_NEAR(lifted["rows"][0]["rise"].get<double>(), 2.0 - (1.0 + 0.9 - 0.75), 0.02);
  EXPECT_THAT(test::read_text(file("lifted.csv")),
              HasSubstr(",500.000000,0.000000,0.900000,failed,"));
  // The same as Feather files.
  const auto column = [](const char* name, double first, double second) {
    return test::WrittenColumn{name, std::vector<double>{first, second}};
  };
  std::ofstream(file("boxes.feather"), std::ios::binary)
      << test::feather_bytes({{"timestamp_ns", std::vector<std::int64_t>{5, 5}},
                              {"category", std::vector<std::string>{"CAR", "CAR"}, false, true},
                              column("length_m", 4, 4),
                              column("width_m", 1.8, 1.8),
                              column("height_m", 1.5, 1.5),
                              column("qw", 1, 1),
                              column("qx", 0, 0),
                              column("qy", 0, 0),
                              column("qz", 0, 0),
                              column("tx_m", 10, 500),
                              column("ty_m", 0, 0),
                              column("tz_m", 0.9, 0.9)});
  std::ofstream(file("poses.feather"), std::ios::binary)
      << test::feather_bytes({{"timestamp_ns", std::vector<std::int64_t>{5}},
                              {"qw", std::vector<double>{1}},
                              {"qx", std::vector<double>{0}},
                              {"qy", std::vector<double>{0}},
                              {"qz", std::vector<double>{0}},
                              {"tx_m", std::vector<double>{10}},
                              {"ty_m", std::vector<double>{0}},
                              {"tz_m", std::vector<double>{1}}});
  ASSERT_EQ(run_camber({"lift", file("boxes.feather"), "--surface", file("hill.csv"), "--poses",
                        file("poses.feather"), "--out", file("of_feather.csv")})
                .exit_code,
            0);
  EXPECT_EQ(test::read_text(file("of_feather.csv")), test::read_text(file("lifted.csv")));
  const json table = json_of({"info", file("boxes.feather"), "--json"})["files"][0];
  EXPECT_EQ(table["kind"], "feather");
  EXPECT_EQ(table["rows"], 2);
  EXPECT_EQ(table["columns"][1]["type"], "dictionary of utf8");
  EXPECT_ONE_SENTENCE(run_camber({"lift", file("boxes.feather"), "--surface", file("hill.csv"),
                                  "--out", file("x.feather")}),
                      2, "expected .csv");
  const std::string whole = test::read_text(file("boxes.feather"));
  std::ofstream(file("cut.feather"), std::ios::binary) << whole.substr(0, whole.size() / 2);
  EXPECT_ONE_SENTENCE(run_camber({"lift", file("cut.feather"), "--surface", file("hill.csv"),
                                  "--out", file("x.csv")}),
                      2, "is it cut?");
  std::ofstream(file("nu.json")) << R"([{"translation": [20, 0, 3], "size": [1.8, 4, 1.5],
    "rotation": [1, 0, 0, 0], "category_name": "vehicle.car"}])";
  ASSERT_EQ(run_camber({"patches", file("hill.csv"), "--out", file("patches")}).exit_code, 0);
  ASSERT_EQ(run_camber({"lift", file("nu.json"), "--surface", file("patches"), "--out",
                        file("nu_lifted.json")})
                .exit_code,
            0);
  const json box = json::parse(test::read_text(file("nu_lifted.json")))[0];
  EXPECT_EQ(box["camber_status"], "ok");
  // The middle stands along the hill's normal above (20, 0, 2).
  const double tilt = std::atan(0.1);
  EXPECT_NEAR(box["translation"][0].get<double>(), 20.0 - 0.75 * std::sin(tilt), 0.02);
  EXPECT_NEAR(box["translation"][2].get<double>(), 2.0 + 0.75 * std::cos(tilt), 0.02);
  EXPECT_ONE_SENTENCE(run_camber({"lift", file("nu.json"), "--surface", file("patches"), "--calib",
                                  file("nu.json"), "--out", file("x.json")}),
                      2, "--calib: found boxes with z up");
  EXPECT_ONE_SENTENCE(
      run_camber({"lift", file("nu.json"), "--surface", file("surface.json"), "--out", file("x")}),
      2, "a camera's frame");
}

}  // namespace
}  // namespace camber
