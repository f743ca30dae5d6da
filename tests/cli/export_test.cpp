// camber export, and OpenCRG roads as inputs of other commands.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "camber/export/opencrg.h"
#include "camber/export/plan_frame.h"
#include "camber/scene/results.h"
#include "export_program.h"

namespace fs = std::filesystem;
using camber::test::run_camber;
using nlohmann::json;

namespace camber {
namespace {

using test::ExportProgram;

TEST_F(ExportProgram, OpenCrgHasTheSurfacesHeights) {
  for (const char* const encoding : {"text", "binary"}) {
    const auto result = run_camber({"export", file("surface.json"), "--to", "opencrg", "--encoding",
                                    encoding, "--out", file("road.crg"), "--json"});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    const json told = json::parse(result.out);
    EXPECT_NEAR(told["length"].get<double>(), 39.0, 0.6);  // goes on to the surface's end
    const CrgRoad road(read_crg(file("road.crg")));
    const PlanFrame frame(surface_.up);
    std::size_t known = 0;
    for (std::size_t i = 0; i < road.sections(); ++i) {
      for (std::size_t j = 0; j < road.v().size(); ++j) {
        const double u = static_cast<double>(i) * road.increment();
        const Eigen::Vector2d place = road.position(u, road.v()[j]);
        const SurfaceQuery truth =
            surface_.query(frame.to_surface({place.x(), place.y(), -1.0}), 0.5);
        ASSERT_EQ(std::isnan(road.node(i, j)), truth.status == Status::kFailed);
        if (truth.status == Status::kFailed) continue;
        ++known;
        EXPECT_NEAR(road.node(i, j), frame.to_plan(truth.point).z(), 1e-5);
      }
    }
    EXPECT_GT(known, 4000u);
    EXPECT_EQ(told["unknown"].get<std::size_t>(), road.sections() * road.v().size() - known);
  }
}

TEST_F(ExportProgram, ProfileGivesHeightsAtPlaces) {
  ASSERT_EQ(
      run_camber({"export", file("surface.json"), "--to", "opencrg", "--out", file("road.crg")})
          .exit_code,
      0);
  std::ofstream(file("uv.csv")) << "u,v\n1.5,0.25\n30,-2\n10,100\n";
  std::ofstream(file("xy.csv")) << "x;y\n2.5;0.25\n31;-2\n";
  const CrgRoad road(read_crg(file("road.crg")));
  for (const std::string kind : {"uv", "xy"}) {
    const auto result =
        run_camber({"profile", file("road.crg"), "--along", file(kind + ".csv"), "--json"});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    const json places = json::parse(result.out)["places"];
    ASSERT_EQ(places.size(), kind == "uv" ? 3u : 2u);
    for (const json& place : places) {
      const double height = road.height(place["u"].get<double>(), place["v"].get<double>());
      if (std::isnan(height)) {
        EXPECT_TRUE(place["height"].is_null());
      } else {
        EXPECT_DOUBLE_EQ(place["height"].get<double>(), height);
      }
    }
    EXPECT_EQ(places[0]["status"], "ok");
    if (kind == "uv") {
      EXPECT_EQ(places[2]["status"], "beyond");
    }
  }
  ASSERT_EQ(run_camber({"profile", file("road.crg"), "--out", file("line.csv")}).exit_code, 0);
  EXPECT_THAT(test::read_text(file("line.csv")),
              ::testing::StartsWith("u_m,v_m,x_m,y_m,height_m,status\n0,0,"));
  for (const std::string option :
       {"--step", "--length", "--reach", "--drift-sigma", "--levelling-sigma-deg"}) {
    EXPECT_ONE_SENTENCE(run_camber({"profile", file("road.crg"), "--json", option, "2"}), 2,
                        option + ": found an OpenCRG file, ");
  }
  // As --print-config has them they are no choice.
  std::ofstream(file("c.toml"))
      << run_camber({"profile", file("road.crg"), "--json", "--print-config"}).out;
  EXPECT_EQ(run_camber({"profile", file("road.crg"), "--config", file("c.toml")}).exit_code, 0);
}

TEST_F(ExportProgram, ProfileTakesCrossSectionsOfAnOpenCrgRoad) {
  ASSERT_EQ(
      run_camber({"export", file("surface.json"), "--to", "opencrg", "--out", file("road.crg")})
          .exit_code,
      0);
  const auto run = run_camber({"profile", file("road.crg"), "--half-width", "2.5", "--crown",
                               "--sections", file("s.svg"), "--plot", file("p.svg"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const json stations = json::parse(run.out)["stations"];
  const CrgRoad road(read_crg(file("road.crg")));
  ASSERT_NEAR(static_cast<double>(stations.size()), road.last_u() - road.first_u() + 1.0, 1.0);
  for (std::size_t k = 2; k + 2 < stations.size(); ++k) {
    const double u = road.first_u() + stations[k]["station"].get<double>();
    // Profiles are smooth: where the grade breaks by 5 % within a cell they round the edge.
    const bool breaks = std::abs(road.height(u + 2.0, 0.0) - 2.0 * road.height(u, 0.0) +
                                 road.height(u - 2.0, 0.0)) > 1e-3;
    EXPECT_NEAR(stations[k]["height"], road.height(u, 0.0), breaks ? 0.025 : 0.01) << u;
    const double slope = 100.0 * (road.height(u, 2.0) - road.height(u, -2.0)) / 4.0;
    EXPECT_NEAR(stations[k]["cross_slope_percent"], slope, 0.3) << u;
  }
  // The surface climbs by 5 %, then 10 %.
  EXPECT_NEAR(stations[6]["grade_percent"], 5.0, 0.2);
  EXPECT_ONE_SENTENCE(
      run_camber({"profile", file("road.crg"), "--crown", "--json", "--bounds", "0,0,1,1"}), 2,
      "--bounds: found an OpenCRG file, expected a cloud");
}

TEST_F(ExportProgram, InfoAndCompareTakeRoads) {
  ASSERT_EQ(
      run_camber({"export", file("surface.json"), "--to", "opencrg", "--out", file("road.crg")})
          .exit_code,
      0);
  const auto info = run_camber({"info", file("road.crg"), "--json"});
  ASSERT_EQ(info.exit_code, 0) << info.error;
  const json told = json::parse(info.out)["files"][0];
  EXPECT_EQ(told["kind"], "opencrg");
  EXPECT_EQ(told["encoding"], "LRFI");
  const auto compared = run_camber({"compare", file("road.crg"), file("road.crg"), "--json"});
  ASSERT_EQ(compared.exit_code, 0) << compared.error;
  EXPECT_NEAR(json::parse(compared.out)["accuracy"]["rms"].get<double>(), 0.0, 1e-6);
}

TEST_F(ExportProgram, OpenDriveTellsHowWellItFits) {
  const auto result = run_camber({"export", file("surface.json"), "--to", "opendrive", "--crg",
                                  "road.crg", "--out", file("road.xodr"), "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const json told = json::parse(result.out);
  EXPECT_LT(told["height_most"].get<double>(), 0.05);  // the bend between the patches is smoothed
  EXPECT_LT(told["height_rms"].get<double>(), 0.01);
  EXPECT_LT(told["line_deviation"].get<double>(), 0.05);
  const std::string text = test::read_text(file("road.xodr"));
  EXPECT_THAT(text, ::testing::Not(::testing::HasSubstr("geoReference")));
  EXPECT_ONE_SENTENCE(run_camber({"export", file("surface.json"), "--to", "opendrive", "--crs",
                                  "EPSG:25832", "--out", file("map.xodr")}),
                      2, "nowhere on a map");
  EXPECT_THAT(text, ::testing::HasSubstr("file=\"road.crg\""));
  EXPECT_ONE_SENTENCE(run_camber({"export", file("surface.json"), "--to", "opendrive", "--vehicles",
                                  "--out", file("cars.xodr")}),
                      2, "vehicles.json");
  EXPECT_ONE_SENTENCE(run_camber({"export", file("surface.json"), "--to", "opencrg", "--crg",
                                  "road.crg", "--out", file("other.crg")}),
                      2, "--to opendrive");
}

TEST_F(ExportProgram, MeshesAndTrajectories) {
  for (const std::string kind : {"glb", "obj", "ply"}) {
    const auto result = run_camber(
        {"export", file("surface.json"), "--to", "mesh", "--out", file("road." + kind), "--json"});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    EXPECT_GT(json::parse(result.out)["triangles"].get<int>(), 1000);
    EXPECT_GT(fs::file_size(file("road." + kind)), 10000u);
  }
  EXPECT_EQ(run_camber({"compare", file("road.ply"), file("road.ply")}).exit_code, 0);
  EXPECT_ONE_SENTENCE(
      run_camber({"export", file("surface.json"), "--to", "mesh", "--out", file("road.stl")}), 2,
      "FILE.glb");
  RunDocument run;
  run.cameras = {{4, SE3()}, {5, SE3(Eigen::Quaterniond::Identity(), {0.0, 0.0, 1.5})}};
  write_json(to_json(run), folder_.path() / "run.json");
  const auto poses = run_camber({"export", folder_.path().string(), "--to", "trajectory", "--out",
                                 file("cameras.csv"), "--json"});
  ASSERT_EQ(poses.exit_code, 0) << poses.error;
  EXPECT_EQ(json::parse(poses.out)["clock"], "frames");
  EXPECT_THAT(test::read_text(file("cameras.csv")),
              ::testing::HasSubstr("5,5.000000,0.000000000,0.000000000,1.500000000"));
  EXPECT_EQ(poses.error, "");
  run.metric = false;
  write_json(to_json(run), folder_.path() / "run.json");
  EXPECT_ONE_SENTENCE(run_camber({"export", folder_.path().string(), "--to", "trajectory", "--out",
                                  file("cameras.tum")}),
                      0, "unknown scale");
}

TEST_F(ExportProgram, CloudsTakeALine) {
  {
    std::ofstream cloud(file("cloud.csv")), line(file("line.csv"));
    cloud << "x,y,z\n";
    line << "x,y,z\n";
    for (int i = 0; i <= 200; ++i) {
      for (int k = -20; k <= 20; ++k) {
        cloud << 0.2 * i << "," << 0.2 * k << "," << 0.01 * i + 0.004 * k << "\n";
      }
    }
    for (int i = 1; i < 39; ++i) line << i << ",0,0\n";
  }
  EXPECT_ONE_SENTENCE(
      run_camber({"export", file("cloud.csv"), "--to", "opencrg", "--out", file("road.crg")}), 2,
      "--along");
  const auto result = run_camber({"export", file("cloud.csv"), "--along", file("line.csv"), "--to",
                                  "opencrg", "--out", file("road.crg"), "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const CrgRoad road(read_crg(file("road.crg")));
  EXPECT_DOUBLE_EQ(road.increment(), 0.2);  // the points' spacing
  EXPECT_NEAR(road.height_at(20.0, 1.0), 0.05 * 20.0 + 0.02 * 1.0, 1e-3);
  // A point far away, which a map's cloud may have at 0, 0, 0, changes nothing.
  const std::string written = test::read_text(file("road.crg"));
  std::ofstream(file("cloud.csv"), std::ios::app) << "500000,5400000,300\n";
  ASSERT_EQ(run_camber({"export", file("cloud.csv"), "--along", file("line.csv"), "--to", "opencrg",
                        "--out", file("road.crg")})
                .exit_code,
            0);
  EXPECT_EQ(test::read_text(file("road.crg")), written);
}

TEST_F(ExportProgram, ALineOffTheGroundsHeightIsNamed) {
  {
    std::ofstream cloud(file("cloud.csv"));
    cloud << "x,y,z\n";
    for (int i = 0; i <= 200; ++i) {
      for (int k = -10; k <= 10; ++k) cloud << 0.2 * i << "," << 0.2 * k << "," << 0.02 * i << "\n";
    }
  }
  const auto with = [&](const std::string& header, const std::string& ends) {
    std::ofstream(file("line.csv")) << header << "\n1,0" << ends << "\n39,0" << ends << "\n";
    return run_camber({"export", file("cloud.csv"), "--along", file("line.csv"), "--to", "opencrg",
                       "--out", file("road.crg")});
  };
  EXPECT_ONE_SENTENCE(with("x,y,z", ",20"), 1,
                      "the ground is 18.00 m below it, expected a line within 1.5 m");
  // Up to 2.6 m, at x = 26, the ground is near enough.
  EXPECT_ONE_SENTENCE(with("x,y,z", ",1.1"), 0, "stations of the line the ground is");
  const auto result = with("x,y", "");
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(result.error, "");
  EXPECT_NEAR(CrgRoad(read_crg(file("road.crg"))).height_at(38.0, 1.0), 3.8, 1e-3);
}

TEST_F(ExportProgram, ANoisyLineIsSmoothed) {
  {
    std::ofstream cloud(file("cloud.csv"));
    cloud << "x,y,z\n";
    for (int i = 0; i <= 300; ++i) {
      for (int k = -20; k <= 20; ++k) cloud << 0.2 * i << "," << 0.2 * k << ",0\n";
    }
  }
  const auto along_every = [&](double step, std::vector<std::string> more) {
    {
      std::mt19937 random(3);
      const auto noise = [&] { return 0.0346 * (2.0 * (random() / 4294967296.0) - 1.0); };  // 2 cm
      std::ofstream line(file("line.csv"));
      line << "x,y,z\n";
      for (double x = 2.0; x < 58.0; x += step) line << x + noise() << "," << noise() << ",0\n";
    }
    std::vector<std::string> words = {"export", file("cloud.csv"), "--along", file("line.csv"),
                                      "--to",   "opencrg",         "--out",   file("road.crg")};
    words.insert(words.end(), more.begin(), more.end());
    return run_camber(words);
  };
  const auto result = along_every(0.5, {"--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(result.error, "");
  const json told = json::parse(result.out);
  EXPECT_NEAR(told["options"]["tolerance"].get<double>(), 0.1, 0.03);  // 5 times the scatter
  EXPECT_LE(told["v"][0].get<double>(), -3.8);
  EXPECT_GE(told["v"][1].get<double>(), 3.8);
  EXPECT_ONE_SENTENCE(along_every(0.5, {"--tolerance", "0.02"}), 0,
                      "--tolerance, now 0.02 m, lets it");
  EXPECT_ONE_SENTENCE(along_every(0.1, {"--tolerance", "0.02"}), 1,
                      "no road fits beside the line; the line bends");
}

TEST_F(ExportProgram, PatchesKeepTheCloudsSystem) {
  {
    std::ofstream cloud(file("cloud.csv")), line(file("line.csv"));
    cloud << std::fixed << "x,y,z\n";
    line << std::fixed << "x,y,z\n";
    for (int i = 0; i <= 100; ++i) {
      for (int k = -20; k <= 20; ++k) {
        cloud << 500000 + 0.4 * i << "," << 4000000 + 0.2 * k << "," << 0.02 * i << "\n";
      }
    }
    for (int i = 1; i < 39; ++i) line << 500000 + i << ",4000000,0\n";
  }
  const auto geo_reference = [&](const std::string& system) {
    const std::string folder = file("patches_" + system.substr(5));
    const auto patches = run_camber({"patches", file("cloud.csv"), "--crs", system, "--up", "0,0,1",
                                     "--out", folder, "--threads", "1"});
    EXPECT_EQ(patches.exit_code, 0) << patches.error;
    const auto info = run_camber({"info", folder + "/labels.ply", "--json"});
    const json crs = json::parse(info.out).at("files").at(0).at("crs");
    EXPECT_EQ(crs.is_null() ? 0 : crs.value("epsg", 0), system == "EPSG:32610" ? 32610 : 0);
    const auto road = run_camber({"export", folder, "--along", file("line.csv"), "--to",
                                  "opendrive", "--out", file("road.xodr"), "--json"});
    return road.exit_code == 0 ? json::parse(road.out).at("geo_reference").get<std::string>()
                               : road.error;
  };
  EXPECT_EQ(geo_reference("EPSG:32610"), "EPSG:32610");
  // Simulators parse PROJ strings, no codes.
  EXPECT_THAT(
      test::read_text(file("road.xodr")),
      ::testing::HasSubstr("<geoReference><![CDATA[+proj=utm +zone=10 +datum=WGS84 +units=m "
                           "+no_defs]]></geoReference>"));
  // Coordinates in feet are converted, and the line, which states no unit, is far away from them.
  EXPECT_THAT(geo_reference("EPSG:2229"), ::testing::HasSubstr("m from the known ground"));
}

TEST_F(ExportProgram, VehiclesAreNamedByTrackAndTilted) {
  RunDocument run;
  run.cameras = {{4, SE3()}};
  write_json(to_json(run), folder_.path() / "run.json");
  // Along the road's climb of 5 %, whose right side is the lower one by 2 %.
  const Eigen::Vector3d front = Eigen::Vector3d(0.0, -0.05, 1.0).normalized();
  const Eigen::Vector3d up = Eigen::Vector3d(1.0, 0.02, 0.0).cross(front).normalized();
  Eigen::Matrix3d axes;
  axes << front, up, front.cross(up);
  VehicleEstimate car;
  car.id = 2;
  car.track = 7;
  car.vehicle_class = "car";
  car.status = Status::kOk;
  car.pose.camera_from_vehicle = SE3(axes, Eigen::Vector3d(1.0, 1.0, 12.0));
  car.pose.dimensions = {4.2, 1.8, 1.5};
  VehicleDocument vehicles;
  vehicles.frames = {{4, {car}}};
  write_json(to_json(vehicles), folder_.path() / "vehicles.json");
  const auto result = run_camber({"export", folder_.path().string(), "--to", "opendrive",
                                  "--vehicles", "--out", file("cars.xodr")});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const std::string text = test::read_text(file("cars.xodr"));
  EXPECT_THAT(text, ::testing::HasSubstr("name=\"car 7\""));
  const auto number = [&](const std::string& name) {
    const std::size_t object = text.find("<object ");
    return std::stod(text.substr(text.find(" " + name + "=\"", object) + name.size() + 3));
  };
  EXPECT_NEAR(number("pitch"), -std::atan(0.05), 1e-4);
  EXPECT_NEAR(number("roll"), std::atan(0.02), 1e-4);
  EXPECT_NEAR(number("hdg"), 0.0, 0.01);
}

TEST_F(ExportProgram, Refusals) {
  const auto with = [&](const std::string& option, const std::string& value) {
    return run_camber(
        {"export", file("surface.json"), "--to", "opencrg", "--out", file("r.crg"), option, value});
  };
  EXPECT_ONE_SENTENCE(with("--step", "-1"), 2, "--step: Value -1 not in range");
  EXPECT_ONE_SENTENCE(with("--left", "-3"), 2, "--left: Value -3 not in range");
  EXPECT_ONE_SENTENCE(with("--ahead", "-10"), 2, "--ahead: found -10, expected metres >= 0");
  std::ofstream(file("gap.csv")) << "x,y,z\n0,1,5\nnan,1,9\n0,1,15\n";
  EXPECT_ONE_SENTENCE(with("--along", file("gap.csv")), 2, "point 2 of the line: found nan");
  EXPECT_ONE_SENTENCE(with("--step", "0.0005"), 2,
                      "--step: found 0.0005, expected 0 or 0.001 to 100 metres");
  EXPECT_ONE_SENTENCE(with("--step-across", "1e-9"), 2,
                      "--step-across: found 1e-09, expected 0 or 0.001 to 100 metres");
  EXPECT_ONE_SENTENCE(with("--step-across", "50"), 2,
                      "--step-across: found 50 m, expected at most 4.00 m, as far as the road");
  EXPECT_ONE_SENTENCE(with("--widest", "nan"), 2, "--widest: found 'nan', expected a number");
  EXPECT_ONE_SENTENCE(run_camber({"export", file("surface.json"), "--to", "trajectory", "--out",
                                  file("cameras.tum")}),
                      2, "expected a result folder");
  surface_.metric = false;
  write_json(to_json(surface_), file("unscaled.json"));
  EXPECT_ONE_SENTENCE(
      run_camber({"export", file("unscaled.json"), "--to", "opencrg", "--out", file("road.crg")}),
      1, "unknown scale");
  EXPECT_ONE_SENTENCE(run_camber({"export", file("surface.json"), "--to", "opencrg", "--out",
                                  file("surface.json")}),
                      2, "surface.json");
  EXPECT_ONE_SENTENCE(run_camber({"export", file("surface.json"), "--to", "opencrg", "--out",
                                  file("no/such/road.crg")}),
                      3, "no/such");
  EXPECT_ONE_SENTENCE(run_camber({"export", file("surface.json"), "--to", "opencrg", "--step", "-1",
                                  "--out", file("road.crg")}),
                      2, "step");
  std::ofstream(file("broken.crg")) << "$CT\n$\n$ROAD_CRG_FILE\nnot_there.crg\n$\n";
  EXPECT_ONE_SENTENCE(run_camber({"profile", file("broken.crg"), "--json"}), 2, "not_there.crg");
  EXPECT_ONE_SENTENCE(run_camber({"info", file("broken.crg")}), 2, "not_there.crg");
  EXPECT_FALSE(fs::exists(file("road.crg")));
}

}  // namespace
}  // namespace camber
