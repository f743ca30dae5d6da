#include "camber/import/formats/trajectory.h"

#include <gmock/gmock.h>

#include <cmath>

#include "camber/core/errors.h"
#include "camber/import/formats/class_map.h"
#include "camber/import/formats/frame_files.h"
#include "import/formats/expected_values.h"
#include "scene/write_image.h"

namespace camber {
namespace {

using nlohmann::json;
using test::write_bytes;
using testing::HasSubstr;
namespace fs = std::filesystem;

/// To 1e-6 relative, as the expected lengths are given.
void expect_length(const json& expected, double found) {
  EXPECT_NEAR(expected.get<double>(), found, 1e-6 * std::abs(expected.get<double>()));
}

double length_of(const std::vector<GeoPoint>& points) {
  double out = 0.0;
  for (std::size_t i = 1; i < points.size(); ++i)
    out += great_circle_distance(points[i - 1], points[i]);
  return out;
}

void expect_point(const json& expected, const GeoPoint& found) {
  EXPECT_EQ(expected["lat"], found.latitude);
  EXPECT_EQ(expected["lon"], found.longitude);
  EXPECT_EQ(expected["ele"], std::isfinite(found.altitude) ? json(found.altitude) : json());
  EXPECT_EQ(expected["time"], found.time_text.empty() ? json() : json(found.time_text));
}

class ExpectedTrajectories : public ::testing::Test {
 protected:
  void SetUp() override { all_ = test::expected_values("trajectories"); }
  fs::path path(const std::string& name) { return test::format_file("trajectories", name); }
  json all_;
};

TEST_F(ExpectedTrajectories, Tum) {
  CAMBER_REQUIRE_DATA("format-files/trajectories/expected.json");
  int files = 0;
  for (const auto& [name, expected] : all_.items()) {
    if (name.rfind("tum/", 0) != 0) continue;
    SCOPED_TRACE(name);
    const PoseFile found = read_poses(path(name));
    EXPECT_EQ(found.form, "TUM");
    ASSERT_EQ(expected["poses"], found.poses.size());
    const auto row = [](const TimedPose& p) {
      return json({p.time_s, p.position.x(), p.position.y(), p.position.z(), p.rotation.x(),
                   p.rotation.y(), p.rotation.z(), p.rotation.w()});
    };
    EXPECT_EQ(expected["first"], row(found.poses.front()));
    EXPECT_EQ(expected["last"], row(found.poses.back()));
    double length = 0.0, norm_error = 0.0;
    bool rising = true;
    for (std::size_t i = 0; i < found.poses.size(); ++i) {
      norm_error = std::max(norm_error, std::abs(found.poses[i].rotation.norm() - 1.0));
      if (i == 0) continue;
      length += (found.poses[i].position - found.poses[i - 1].position).norm();
      rising = rising && found.poses[i].time_s > found.poses[i - 1].time_s;
    }
    expect_length(expected["length"], length);
    EXPECT_EQ(expected["times_rise"], rising);
    EXPECT_NEAR(expected["largest_quaternion_norm_error"].get<double>(), norm_error, 1e-15);
    ++files;
  }
  EXPECT_EQ(files, 4);
}

TEST_F(ExpectedTrajectories, MatrixAndKapture) {
  CAMBER_REQUIRE_DATA("format-files/trajectories/expected.json");
  const char* matrix = "matrix/7scenes_frame-000000.pose.txt";
  const PoseFile one = read_poses(path(matrix));
  ASSERT_EQ(one.poses.size(), 1u);
  ASSERT_TRUE(one.poses[0].matrix);
  const Eigen::Matrix4d rigid = one.poses[0].world_from_body().matrix();
  for (int i = 0; i < 16; ++i) {
    const double expected = all_[matrix]["matrix"][i / 4][i % 4];
    EXPECT_EQ(expected, (*one.poses[0].matrix)(i / 4, i % 4));
    // As written its 3 x 3 part is 6e-5 short of a rotation.
    EXPECT_NEAR(expected, rigid(i / 4, i % 4), 1e-4);
  }
  const json& expected = all_["kapture/trajectories.txt"];
  const PoseFile kapture = read_poses(path("kapture/trajectories.txt"));
  ASSERT_EQ(expected["poses"], kapture.poses.size());
  const TimedPose& first = kapture.poses.front();
  EXPECT_EQ(expected["first"]["timestamp"], first.time_s);
  EXPECT_EQ(expected["first"]["device"], first.name);
  const SE3 camera_from_world = first.world_from_body().inverse();
  const Eigen::Quaterniond q = camera_from_world.rotation();
  const Eigen::Vector4d wxyz(q.w(), q.x(), q.y(), q.z());
  for (int i = 0; i < 4; ++i) {
    // Six digits, made unit.
    EXPECT_NEAR(expected["first"]["q_wxyz_world_to_camera"][i].get<double>(), wxyz[i], 1e-6);
  }
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(expected["first"]["t"][i].get<double>(), camera_from_world.translation()[i], 1e-9);
    EXPECT_NEAR(expected["first"]["camera_centre"][i].get<double>(), first.position[i], 1e-6);
    EXPECT_NEAR(expected["last_camera_centre"][i].get<double>(), kapture.poses.back().position[i],
                1e-5);
  }
}

TEST_F(ExpectedTrajectories, Gpx) {
  CAMBER_REQUIRE_DATA("format-files/trajectories/expected.json");
  int files = 0;
  for (const auto& [name, expected] : all_.items()) {
    if (name.rfind("gpx/", 0) != 0) continue;
    SCOPED_TRACE(name);
    const GeoLog found = read_geo_log(path(name));
    EXPECT_EQ(expected["version"], found.version);
    EXPECT_EQ(expected["creator"], found.creator);
    EXPECT_EQ(expected["tracks"], found.tracks);
    json segments = json::array();
    std::vector<GeoPoint> points, route_points;
    double length = 0.0;
    int elevations = 0, times = 0;
    for (const auto& segment : found.segments) {
      segments.push_back(segment.size());
      length += length_of(segment);
      points.insert(points.end(), segment.begin(), segment.end());
    }
    for (const GeoPoint& p : points) {
      elevations += std::isfinite(p.altitude) ? 1 : 0;
      times += p.time_text.empty() ? 0 : 1;
    }
    for (const auto& route : found.routes)
      route_points.insert(route_points.end(), route.begin(), route.end());
    EXPECT_EQ(expected["segments"], segments);
    EXPECT_EQ(expected["track_points"], points.size());
    EXPECT_EQ(expected["routes"], found.routes.size());
    EXPECT_EQ(expected["route_points"], route_points.size());
    EXPECT_EQ(expected["waypoints"], found.waypoints.size());
    EXPECT_EQ(expected["points_with_elevation"], elevations);
    EXPECT_EQ(expected["points_with_time"], times);
    expect_length(expected["great_circle_length_m_within_segments"], length);
    for (const auto& [kind, list] :
         {std::pair<std::string, const std::vector<GeoPoint>*>("track", &points),
          {"route", &route_points},
          {"waypoint", &found.waypoints}}) {
      if (expected.contains("first_" + kind + "_point"))
        expect_point(expected["first_" + kind + "_point"], list->front());
      if (expected.contains("last_" + kind + "_point"))
        expect_point(expected["last_" + kind + "_point"], list->back());
    }
    ++files;
  }
  EXPECT_EQ(files, 5);
}

TEST_F(ExpectedTrajectories, NmeaAndCsv) {
  CAMBER_REQUIRE_DATA("format-files/trajectories/expected.json");
  for (const char* name :
       {"nmea/pynmea2_data.log", "nmea/nmea2.log", "nmea/addmultipledaysfwd.nmea"}) {
    SCOPED_TRACE(name);
    const json& expected = all_[name];
    const GeoLog found = read_geo_log(path(name));
    int right = 0;
    for (const auto& [type, count] : found.sentences) right += count;
    EXPECT_EQ(expected["sentences_with_right_checksum"], right);
    EXPECT_EQ(expected["sentences_with_wrong_checksum"], found.wrong_checksums);
    EXPECT_EQ(expected["other_lines"], found.other_lines);
    EXPECT_EQ(expected["by_type"], json(found.sentences));
    EXPECT_EQ(expected["rmc_valid"], found.valid_rmc);
    const std::vector<GeoPoint>& fixes = found.segments[0];
    ASSERT_EQ(expected["gga_fixes"], fixes.size());
    if (fixes.empty()) continue;
    for (const auto& [key, fix] :
         {std::pair("first_gga_fix", fixes.front()), std::pair("last_gga_fix", fixes.back())}) {
      EXPECT_EQ(expected[key]["time"], fix.time_text);
      EXPECT_DOUBLE_EQ(expected[key]["lat"], fix.latitude);
      EXPECT_DOUBLE_EQ(expected[key]["lon"], fix.longitude);
      EXPECT_EQ(expected[key]["alt"], fix.altitude);
    }
    expect_length(expected["great_circle_length_m"], length_of(fixes));
    for (std::size_t i = 1; i < fixes.size(); ++i)
      EXPECT_GT(fixes[i].time_s, fixes[i - 1].time_s) << "past midnight";
  }
  const json& expected = all_["csv/bike_unicsv.csv"];
  const GeoLog found = read_geo_log(path("csv/bike_unicsv.csv"));
  EXPECT_EQ(expected["header"], found.columns);
  ASSERT_EQ(expected["rows"], found.segments[0].size());
  for (const auto& [key, point] : {std::pair("first", found.segments[0].front()),
                                   std::pair("last", found.segments[0].back())}) {
    EXPECT_EQ(expected[key]["lat"], point.latitude);
    EXPECT_EQ(expected[key]["lon"], point.longitude);
    EXPECT_EQ(expected[key]["alt"], point.altitude);
  }
  expect_length(expected["great_circle_length_m"], length_of(found.segments[0]));
  EXPECT_EQ(found.segments[0].front().time_s, 1367331837.0);  // 2013-04-30 14:23:57
}

TEST(ExpectedClassMaps, HoldTheirClasses) {
  CAMBER_REQUIRE_DATA("format-files/class-maps/expected.json");
  const json all = test::expected_values("class-maps");
  for (const auto& [name, expected] : all.items()) {
    SCOPED_TRACE(name);
    const ClassMap found = read_class_map(test::format_file("class-maps", name));
    EXPECT_EQ(expected["classes"], found.classes.size());
    std::set<std::array<int, 3>> colors;
    for (const MaskClass& one : found.classes) {
      if (one.color) colors.insert(*one.color);
    }
    if (expected.contains("different_colours")) {
      EXPECT_EQ(expected["different_colours"], colors.size());
    }
    const std::string road_name = expected.contains("road")
                                      ? expected["road"]["name"].get<std::string>()
                                  : name == "voc_labelmap.txt" ? "car"
                                                               : "road";
    const auto at = std::find_if(found.classes.begin(), found.classes.end(),
                                 [&](const MaskClass& c) { return c.name == road_name; });
    ASSERT_NE(at, found.classes.end());
    if (expected.contains("road")) {
      const json& road = expected["road"];
      EXPECT_EQ(road["red"], std::to_string((*at->color)[0]));
      EXPECT_EQ(road["green"], std::to_string((*at->color)[1]));
      EXPECT_EQ(road["blue"], std::to_string((*at->color)[2]));
      if (road.contains("id")) {
        EXPECT_EQ(road["id"], std::to_string(*at->id));
      }
      if (road.contains("train_id")) {
        EXPECT_EQ(road["train_id"], std::to_string(*at->train_id));
      }
      if (road.contains("category")) {
        EXPECT_EQ(road["category"], at->category);
      }
      EXPECT_EQ(role_of_class(at->name), MaskRole::kRoad);
    }
    if (expected.contains("road_id")) {
      EXPECT_EQ(expected["road_id"], *at->id);
      const json& bgr = expected["road_colour_as_written"];
      EXPECT_EQ(*at->color, (std::array<int, 3>{bgr[2], bgr[1], bgr[0]}));
      EXPECT_EQ(expected["learning_map_of_road"], *at->train_id);
    }
    if (name == "voc_labelmap.txt") {
      EXPECT_EQ(*at->color, (std::array<int, 3>{128, 128, 128}));
    }
  }
  // The maps that are known by name agree with the data sets' tables.
  for (const auto& [file, known] : {std::pair("cityscapes.csv", "cityscapes"),
                                    std::pair("mapillary_vistas_2.0.csv", "mapillary-2")}) {
    const ClassMap table = read_class_map(test::format_file("class-maps", file));
    const auto named = named_class_map(known);
    ASSERT_TRUE(named);
    for (const MaskClass& one : table.classes) {
      const MaskRole role = role_of_class(one.name);
      if (role == MaskRole::kOther) continue;
      const auto at = std::find_if(named->classes.begin(), named->classes.end(),
                                   [&](const MaskClass& c) { return c.id == one.id; });
      ASSERT_NE(at, named->classes.end()) << known << ": " << one.name;
      EXPECT_EQ(role_of_class(at->name), role) << one.name;
    }
  }
}

class Tracks : public ::testing::Test {
 protected:
  fs::path file(const std::string& name, const std::string& text) {
    write_bytes(folder_.path() / name, text);
    return folder_.path() / name;
  }
  template <typename Read>
  std::string error_of(const Read& read) {
    try {
      read();
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  test::TemporaryFolder folder_;
};

TEST_F(Tracks, PosesOfKittiEurocAndColmap) {
  const PoseFile kitti =
      read_poses(file("p.txt", "1 0 0 1 0 1 0 2 0 0 1 3\n1 0 0 4 0 1 0 5 0 0 1 6"));
  EXPECT_EQ(kitti.form, "KITTI");
  EXPECT_EQ(kitti.poses[1].position, Eigen::Vector3d(4, 5, 6));
  EXPECT_TRUE(std::isnan(kitti.poses[0].time_s));
  const PoseFile euroc =
      read_poses(file("e.csv",
                      "#timestamp [ns], p_RS_R_x [m], ...\n"
                      "1403636580838555648,4.6,-1.7,0.8,0.5,-0.5,0.5,-0.5,1,2,3\r\n"));
  EXPECT_EQ(euroc.form, "EuRoC");
  EXPECT_NEAR(euroc.poses[0].time_s, 1403636580.838555648, 1e-6);
  EXPECT_EQ(euroc.poses[0].rotation.w(), 0.5);
  const PoseFile colmap =
      read_poses(file("images.txt", "# IMAGE_ID, QW, ...\n1 1 0 0 0 1 2 3 1 a.jpg\n10 20 -1\n"));
  EXPECT_EQ(colmap.form, "COLMAP");
  EXPECT_EQ(colmap.poses[0].name, "a.jpg");
  EXPECT_EQ(colmap.poses[0].position, Eigen::Vector3d(-1, -2, -3));
}

TEST_F(Tracks, SpeedsOfTablesAndLogs) {
  const SpeedLog bare = read_speeds(file("s.csv", "1.0,10\n0.0,8,\n"));
  ASSERT_EQ(bare.samples.size(), 2u);
  EXPECT_EQ(bare.samples[0].speed, 8.0);  // by time
  EXPECT_EQ(bare.samples[1].sigma, 0.2);
  const SpeedLog kmh = read_speeds(file("k.csv", "time_s;speed_kmh;sigma\n0.5;36;3.6\n"));
  EXPECT_DOUBLE_EQ(kmh.samples[0].speed, 10.0);
  EXPECT_DOUBLE_EQ(kmh.samples[0].sigma, 1.0);
  const std::string point =
      "<trkpt lat=\"48.0\" lon=\"11.0\"><time>2024-05-01T12:00:00Z</time></trkpt>"
      "<trkpt lat=\"48.0001\" lon=\"11.0\"><time>2024-05-01T12:00:01Z</time></trkpt>";
  const SpeedLog gpx = read_speeds(
      file("t.gpx", "<gpx version=\"1.1\"><trk><trkseg>" + point + "</trkseg></trk></gpx>"));
  ASSERT_EQ(gpx.samples.size(), 1u);
  EXPECT_NEAR(gpx.samples[0].speed, 11.12, 0.01);
  EXPECT_EQ(gpx.samples[0].time_s, 1714564800.5);
  EXPECT_GT(gpx.samples[0].sigma, 0.5);
  const SpeedLog nmea = read_speeds(
      file("n.log", "$GPRMC,120000.00,A,4807.038,N,01131.000,E,022.4,084.4,010524,003.1,W*47\r\n"));
  ASSERT_EQ(nmea.samples.size(), 1u);
  EXPECT_NEAR(nmea.samples[0].speed, 22.4 * 1852 / 3600, 1e-12);
  EXPECT_EQ(nmea.samples[0].time_s, 1714564800.0);
  EXPECT_FALSE(nmea.times_of_day);
  EXPECT_THAT(
      error_of([&] {
        read_speeds(file(
            "w.log", "$GPRMC,120000.00,A,4807.038,N,01131.000,E,099.9,084.4,010524,003.1,W*40\n"));
      }),
      HasSubstr("found no time with a speed"));
}

TEST_F(Tracks, SpeedsWithoutNamesMustLookLikeThem) {
  for (const char* const rows :
       {"0.0,48.1,11.5,10\n1.0,48.2,11.6,11\n",  // more columns than there are meanings
        "10,0.0\n11,0.1\n10.5,0.2\n",            // speed, time
        "0,90\n1,120\n",                         // km/h
        "48.10001,11.5\n48.10002,11.6\n",        // latitude, longitude
        "0.0,0.3,25\n1.0,0.4,26\n"}) {
    EXPECT_THAT(error_of([&] { read_speeds(file("s.csv", rows)); }),
                HasSubstr("without a line of names"))
        << rows;
  }
  EXPECT_EQ(read_speeds(file("s.csv", "0.0,20,0.5\n0.1,20.5,0.5\n")).samples[1].sigma, 0.5);
}

TEST_F(Tracks, SentencesInTimeStampsAsDashCamerasWriteThem) {
  const std::string text =
      "[1714564800000]$GPRMC,120000.00,A,4807.038,N,01131.000,E,022.4,084.4,010524,003.1,W*47"
      "[1714564800000]\r\n[1714564801000]$GPRMC,120001.00,A,4807.050,N,01131.000,E,022.4,084.4,"
      "010524,003.1,W*48[1714564801000]\r\n";
  const SpeedLog speeds = read_speeds(file("n.nmea", text));
  ASSERT_EQ(speeds.samples.size(), 2u);
  EXPECT_EQ(speeds.samples[1].time_s, 1714564801.0);
  // Without GGA the places are RMC's.
  const GeoLog log = read_geo_log(file("n.nmea", text));
  ASSERT_EQ(log.segments.at(0).size(), 2u);
  EXPECT_NEAR(log.segments[0][0].latitude, 48.1173, 1e-9);
  EXPECT_EQ(log.segments[0][1].time_s, 1714564801.0);
  EXPECT_EQ(log.wrong_checksums, 0);
}

TEST_F(Tracks, PositionsOfRtklib) {
  const std::string head =
      "% program   : RTKPOST\n"
      "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)  "
      " "
      "sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio\n";
  const GeoLog log = read_geo_log(file(
      "r.pos", head + "2024/05/01 23:59:58.000   48.000000000   -9.500000000   323.2000   1  12   "
                      "0.0100   0.0080   0.0400   0 0 0 0.00 99.0\n"
                      "2024/05/01 23:59:58.100   48.000008993   -9.500000000   323.2000   5   9   "
                      "2.0000   1.0000   3.0000   0 0 0 0.00 0.0\n"));
  EXPECT_EQ(log.form, "RTKLIB");
  const std::vector<GeoPoint>& points = log.segments.at(0);
  ASSERT_EQ(points.size(), 2u);
  EXPECT_EQ(points[0].time_s, 1714607998.0);
  EXPECT_EQ(points[1].longitude, -9.5);
  EXPECT_EQ(points[0].altitude, 323.2);
  EXPECT_LT(points[0].sigma, 0.05);  // a fix, not the metres of a single receiver
  EXPECT_EQ(points[0].height_sigma, 0.04);
  EXPECT_NEAR(points[1].sigma, std::sqrt(2.5), 1e-12);
  EXPECT_EQ(log.leap_seconds, 18.0);
  EXPECT_EQ(read_geo_log(file("u.pos",
                              "%  UTC  latitude(deg) longitude(deg) height(m) Q ns\n"
                              "2312 345598.0 48.0 -9.5 323.2 2 8\n"))
                .leap_seconds,
            0.0);
  EXPECT_EQ(read_geo_log(file("u.pos",
                              "%  UTC  latitude(deg) longitude(deg) height(m) Q ns\n"
                              "2312 345598.0 48.0 -9.5 323.2 2 8\n"))
                .segments.at(0)
                .at(0)
                .time_s,
            1714607998.0);
  EXPECT_THAT(error_of([&] {
                read_geo_log(file("e.pos",
                                  "%  GPST  x-ecef(m) y-ecef(m) z-ecef(m) Q ns\n"
                                  "2312 345598.0 1 2 3 1 8\n"));
              }),
              HasSubstr("line 1: found other columns"));
  EXPECT_THAT(
      error_of([&] { read_geo_log(file("f.pos", head + "2024/05/01 23:59:58 48.0 x 1\n")); }),
      HasSubstr("line 3: found 'x'"));
}

TEST_F(Tracks, FixesOfRtkInNmeaHaveCentimetres) {
  const GeoLog log = read_geo_log(
      file("g.nmea",
           "$GPGGA,120000.00,4807.038,N,01131.000,E,4,12,0.6,545.4,M,46.9,M,1.0,0000*49\n"
           "$GPGGA,120001.00,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*66\n"));
  ASSERT_EQ(log.segments.at(0).size(), 2u);
  EXPECT_LT(log.segments[0][0].sigma, 0.05);
  EXPECT_TRUE(std::isnan(log.segments[0][1].sigma));
}

TEST_F(Tracks, TablesOfDatesAndDecimalCommas) {
  const std::string table =
      "Time (UTC);Latitude;Longitude;Speed (km/h)\n2024-05-01 23:59:58;48.0;-9.5;36,0\n"
      "2024-05-01 23:59:59;48.0001;-9.5;37,8\n";
  const SpeedLog speeds = read_speeds(file("iso.csv", table));
  ASSERT_EQ(speeds.samples.size(), 2u);
  EXPECT_EQ(speeds.samples[0].time_s, 1714607998.0);
  EXPECT_DOUBLE_EQ(speeds.samples[1].speed, 10.5);
  const GeoLog log = read_geo_log(file("iso.csv", table));
  EXPECT_EQ(log.segments.at(0).at(1).time_s, 1714607999.0);
}

TEST_F(Tracks, NamesOfColumnsMayHaveTheirUnits) {
  const GeoLog log =
      read_geo_log(file("u.csv",
                        "Timestamp,Latitude (deg),Longitude [°],Altitude (ft),Speed (km/h)\n"
                        "0,49,9,100,36\n1,49.5,9.25,200,72\n"));
  ASSERT_EQ(log.segments.size(), 1u);
  ASSERT_EQ(log.segments[0].size(), 2u);
  EXPECT_EQ(log.segments[0][1].latitude, 49.5);
  EXPECT_EQ(log.segments[0][1].longitude, 9.25);
  EXPECT_DOUBLE_EQ(log.segments[0][1].altitude, 60.96);
  EXPECT_DOUBLE_EQ(log.segments[0][1].speed, 20.0);
  for (const auto& [unit, metres] :
       {std::pair("m/s", 1.0), std::pair("km/h", 1.0 / 3.6), std::pair("mph", 0.44704),
        std::pair("knots", 1852.0 / 3600.0)}) {
    for (const std::string& name :
         {"Speed (" + std::string(unit) + ")", "v [" + std::string(unit) + "]",
          "GPS speed(" + std::string(unit) + ")"}) {
      const SpeedLog speeds = read_speeds(file("v.csv", "t;" + name + "\n0,0;36\n0,5;18\n"));
      ASSERT_EQ(speeds.samples.size(), 2u) << name;
      EXPECT_DOUBLE_EQ(speeds.samples[1].time_s, 0.5) << name;
      EXPECT_NEAR(speeds.samples[1].speed, 18.0 * metres, 1e-12) << name;
    }
  }
  EXPECT_THAT(error_of([&] { read_speeds(file("w.csv", "time,speed (furlongs)\n0,1\n")); }),
              HasSubstr("found no columns of a time and a speed"));
  EXPECT_THAT(error_of([&] { read_geo_log(file("r.csv", "time,lat (rad),lon (rad)\n0,1,1\n")); }),
              HasSubstr("found no columns latitude and longitude"));
}

TEST_F(Tracks, PosesInNanosecondsWithDecimals) {
  for (const char* const row :
       {"1317043079287203072.000000 0.0 0.0 0.9 0 0 0 1\n", "1317043079287203072 0 0 0.9 0 0 0 1\n",
        "1317043079287203.0 0 0 0.9 0 0 0 1\n", "1317043079.287203072 0 0 0.9 0 0 0 1\n"}) {
    EXPECT_NEAR(read_poses(file("t.txt", row)).poses.at(0).time_s, 1317043079.287203, 1e-5) << row;
  }
}

TEST_F(Tracks, AttitudesBecomeUp) {
  EXPECT_LT((up_in_camera(0, 0) - Eigen::Vector3d(0, -1, 0)).norm(), 1e-15);
  // Front down by 10 degrees: up leans away from where the camera looks; left side up: to the
  // right.
  EXPECT_LT(up_in_camera(0, 0.17).z(), -0.1);
  EXPECT_LT(up_in_camera(0.17, 0).x(), -0.1);
  const auto rows = read_attitudes(file("a.csv", "frame,roll_deg,pitch_deg\n3,1,-2\n"));
  EXPECT_EQ(rows[0].frame, 3);
  EXPECT_NEAR(rows[0].pitch, -0.0349, 1e-4);
  EXPECT_THAT(error_of([&] { read_attitudes(file("b.csv", "frame,roll,pitch\n3,1,-20\n")); }),
              HasSubstr("line 2: found a roll or pitch beyond 90"));
  std::string record;
  for (int i = 0; i < 30; ++i) record += std::to_string(i) + ".5 ";
  const auto oxts = read_oxts(file("oxts.txt", record + "\n"));
  EXPECT_EQ(oxts[0].roll, 3.5);
  EXPECT_EQ(oxts[0].forward_speed, 8.5);
}

TEST_F(Tracks, ThatAreBrokenAreRefusedWithTheirPosition) {
  EXPECT_THAT(error_of([&] { read_poses(file("p.txt", "0 1 2 3 0 0 0 5\n")); }),
              HasSubstr("line 1: found a quaternion of length 5"));
  EXPECT_THAT(error_of([&] { read_poses(file("p.txt", "1 2 3\n")); }),
              HasSubstr("line 1: found 3 columns"));
  EXPECT_THAT(error_of([&] { read_poses(file("p.txt", "0 1 2 3 0 0 0 1\n0 1 2 3 0 0 x 1\n")); }),
              HasSubstr("line 2, field 7: found 'x'"));
  EXPECT_THAT(error_of([&] { read_poses(file("p.txt", "")); }), HasSubstr("found no pose"));
  EXPECT_THAT(
      error_of([&] {
        read_geo_log(
            file("g.gpx", "<gpx><trk><trkseg>\n<trkpt lat=\"x\" lon=\"1\"/></trkseg></trk></gpx>"));
      }),
      HasSubstr("line 2: found 'x' for lat"));
  EXPECT_THAT(error_of([&] { read_geo_log(file("g.csv", "a,b\n1,2\n")); }),
              HasSubstr("latitude and longitude"));
  EXPECT_THAT(error_of([&] { read_speeds(file("s.csv", "time,speed\n1,x\n")); }),
              HasSubstr("line 2, field 2: found 'x', expected a speed"));
  EXPECT_THAT(error_of([&] { read_class_map(file("c.csv", "a,b\n1,2\n")); }),
              HasSubstr("found no column name"));
  EXPECT_THAT(
      error_of([&] {
        read_class_map(file("c.yaml", "labels:\n  40: road\ncolor_map:\n  40: [1e300, 0, 0]\n"));
      }),
      HasSubstr("line 4, column 7: found 3 values, expected blue, green, red, each from 0 to 255"));
  EXPECT_THAT(error_of([&] { read_class_map(file("c.csv", "name,id\nroad,x\n")); }),
              HasSubstr("line 2, field 2: found 'x'"));
}

TEST(FrameFiles, NaturalOrderAndTimesInNames) {
  EXPECT_TRUE(natural_less("f2.png", "f10.png"));
  EXPECT_FALSE(natural_less("f10.png", "f2.png"));
  EXPECT_TRUE(natural_less("a1b2", "a1b10"));
  EXPECT_EQ(time_from_name("1305031102.175304.png"), 1305031102.175304);
  EXPECT_NEAR(*time_from_name("1403636579763555584.png"), 1403636579.763555584, 1e-6);
  EXPECT_EQ(time_from_name("1714564800250.jpg"), 1714564800.25);
  EXPECT_EQ(time_from_name("2024-05-01_12-00-00.250.jpg"), 1714564800.25);
  EXPECT_EQ(time_from_name("VID_20240501_120000.jpg"), 1714564800.0);
  EXPECT_FALSE(time_from_name("frame_000123.png"));
  EXPECT_EQ(parse_date_time("2024-05-01T14:00:00+02:00"), 1714564800.0);
  EXPECT_FALSE(parse_date_time("2024-13-01T14:00:00Z"));
}

}  // namespace
}  // namespace camber
