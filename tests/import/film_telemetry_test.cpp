#include "camber/import/film_telemetry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "camber/core/errors.h"
#include "camber/import/formats/gpmf.h"
#include "camber/import/formats/mp4_film.h"
#include "support/made_film.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using test::MadeFix;
using testing::HasSubstr;
using testing::Not;

std::vector<MapPlace> plain_map(const std::string&, const std::vector<GeoPoint>& points) {
  std::vector<MapPlace> out;
  for (const GeoPoint& p : points) out.push_back({1e5 * p.longitude, 1e5 * p.latitude, 0.0});
  return out;
}

/// North with 10 m/s, by the map above, from `start` seconds on.
std::vector<MadeFix> northward(double start, int count, double step) {
  std::vector<MadeFix> out;
  for (int i = 0; i < count; ++i) {
    out.push_back({48.0 + 1e-4 * (start + step * i), 11.0, 500.0, 10.0});
  }
  return out;
}

/// Three seconds of a camera.
std::vector<std::string> drive(const std::string& kind = "GPS5") {
  std::vector<std::string> out;
  for (int second = 0; second < 3; ++second) {
    const std::vector<MadeFix> fixes = northward(second, 10, 0.1);
    const std::string gps =
        kind == "GPS5" ? test::gps5_stream(fixes, 3, 160) : test::gps9_stream(fixes, 3, 1.6);
    out.push_back(test::payload(
        gps + test::gravity_stream({{0.02, -0.995, 0.0979}, {0.02, -0.995, 0.0979}})));
  }
  return out;
}

class FilmTelemetry : public ::testing::Test {
 protected:
  FilmTelemetry() {
    for (int i = 0; i < 20; ++i) {
      SceneFrame frame;
      frame.id = i;
      frame.time_s = 0.1 * i;
      import_.scene.frames.push_back(frame);
    }
    options_.gnss.projection = plain_map;
  }
  void write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_.path() / name, std::ios::binary) << bytes;
  }
  fs::path film() const { return folder_.path() / "drive.mp4"; }
  void put() { put_film_telemetry(film(), true, options_, import_); }
  std::size_t speeds() const {
    std::size_t out = 0;
    for (const SceneFrame& frame : import_.scene.frames) out += frame.speed ? 1 : 0;
    return out;
  }
  const SceneFrame& frame(std::size_t i) const { return import_.scene.frames[i]; }
  /// Forgets what the frames were given.
  void clear() {
    OwnImport fresh;
    for (const SceneFrame& frame : import_.scene.frames) {
      SceneFrame bare;
      bare.id = frame.id;
      bare.time_s = frame.time_s;
      fresh.scene.frames.push_back(bare);
    }
    import_ = std::move(fresh);
  }

  test::TemporaryFolder folder_;
  OwnImport import_;
  OwnDataOptions options_;
};

TEST_F(FilmTelemetry, TheTrackOfACameraGivesPositionsSpeedsAndGravity) {
  for (const char* kind : {"GPS5", "GPS9"}) {
    SCOPED_TRACE(kind);
    clear();
    write("drive.mp4", test::film_of_telemetry(drive(kind)));
    put();
    EXPECT_THAT(import_.telemetry,
                HasSubstr("telemetry of drive.mp4: HERO11 Black, GPS at 10 Hz, fix in 3 "
                          "dimensions, dilution of precision 1.6; the frames get its positions, "
                          "speeds, gravity"));
    for (const std::size_t i : {0u, 7u, 19u}) {
      ASSERT_TRUE(frame(i).map_position && frame(i).speed && frame(i).up) << i;
      const double time = 0.1 * static_cast<double>(i);
      // 1e-7 degrees are 0.01 m of the plain map.
      EXPECT_NEAR(frame(i).map_position->position.y(), 4800000.0 + 10.0 * time, 0.02);
      EXPECT_NEAR(frame(i).map_position->position.z(), 500.0, 1e-9);
      EXPECT_NEAR(frame(i).map_position->sigma, 1.5 * 1.6, 1e-9);
      EXPECT_NEAR(*frame(i).speed, 10.0, 1e-9);
      EXPECT_NEAR(frame(i).up->y(), -0.995, 1e-3);
      EXPECT_NEAR(frame(i).up->z(), 0.0979, 1e-3);
      // The lean of 0.02 may be to the other side.
      EXPECT_NEAR(frame(i).up_sigma, std::hypot(options_.up_sigma, 0.04), 1e-4);
    }
  }
}

TEST_F(FilmTelemetry, AVectorThatPointsDownIsGravityToo) {
  std::vector<std::string> payloads;
  for (int i = 0; i < 3; ++i) {
    payloads.push_back(test::payload(test::gravity_stream({{0.0, 0.995, -0.0979}})));
  }
  write("drive.mp4", test::film_of_telemetry(payloads));
  put();
  ASSERT_TRUE(frame(5).up);
  EXPECT_NEAR(frame(5).up->z(), 0.0979, 1e-3);
  EXPECT_THAT(import_.telemetry, HasSubstr("no GPS; the frames get its gravity"));
  clear();
  put_film_telemetry(film(), false, options_, import_);  // the film is turned: its axes are others
  EXPECT_FALSE(frame(5).up);
}

TEST_F(FilmTelemetry, WhatHasNoFixIsLeftOut) {
  std::vector<std::string> payloads = drive();
  payloads[0] = test::payload(test::gps5_stream(northward(0.0, 10, 0.1), 0, 9999) +
                              test::gravity_stream({{0.0, 0.0, 0.0}}));
  write("drive.mp4", test::film_of_telemetry(payloads));
  put();
  EXPECT_FALSE(frame(5).speed);
  EXPECT_TRUE(frame(15).speed);
  EXPECT_FALSE(frame(5).up);
  EXPECT_THAT(import_.telemetry, HasSubstr("10 times without a fix"));
  clear();
  write("drive.mp4", test::film_of_telemetry({payloads[0]}));
  put();
  EXPECT_EQ(speeds(), 0u);
  EXPECT_THAT(import_.telemetry, HasSubstr("GPS without a fix; nothing of it is taken"));
}

TEST_F(FilmTelemetry, ATrackThatBeginsLaterIsLater) {
  write("drive.mp4", test::film_of_telemetry(drive(), 0, /*delay_ms=*/400));
  put();
  EXPECT_FALSE(frame(3).speed);
  ASSERT_TRUE(frame(14).map_position);
  EXPECT_NEAR(frame(14).map_position->position.y(), 4800000.0 + 10.0, 0.02);
  clear();
  options_.telemetry.offset = -0.4;
  put();
  ASSERT_TRUE(frame(14).map_position);
  EXPECT_NEAR(frame(14).map_position->position.y(), 4800000.0 + 14.0, 0.02);
}

TEST_F(FilmTelemetry, OptionsAndPersonsGoBefore) {
  write("drive.mp4", test::film_of_telemetry(drive()));
  options_.telemetry.use = false;
  put();
  EXPECT_EQ(import_.telemetry, "");
  EXPECT_EQ(speeds(), 0u);
  options_.telemetry.use = true;
  options_.speed = "speeds.csv";
  options_.up = "up.csv";
  options_.gnss.projection = nullptr;
  put();
  EXPECT_EQ(speeds(), 0u);
  EXPECT_THAT(import_.telemetry, HasSubstr("nothing of it is taken"));
}

TEST_F(FilmTelemetry, FilmsWithoutAnyAreAsTheyWere) {
  write("drive.mp4", test::film_of_telemetry({}));
  put();
  write("drive.mp4", "RIFF no such container");
  put();
  write("drive.srt", "1\n00:00:00,000 --> 00:00:02,000\nHello!\n");
  put();
  EXPECT_EQ(import_.telemetry, "");
  EXPECT_TRUE(import_.found.empty());
}

TEST_F(FilmTelemetry, SubtitlesOnTheFilmsClock) {
  write("drive.mp4", test::film_of_telemetry({}));
  std::string text;
  for (int i = 0; i < 24; ++i) {  // the receiver has a new position every half second
    const double latitude = 48.0 + 0.5e-4 * (i / 5);
    char line[400];
    std::snprintf(line, sizeof line,
                  "%d\n00:00:0%d,%03d --> 00:00:0%d,%03d\n<font size=\"28\">FrameCnt: %d\n"
                  "[iso: 100] [latitude: %.6f] [longitude: 11.000000] [rel_alt: 1.300 abs_alt: "
                  "512.500] </font>\n\n",
                  i + 1, i / 10, 100 * (i % 10), i / 10, 100 * (i % 10) + 90, i, latitude);
    text += line;
  }
  write("drive.srt", text);
  put();
  EXPECT_THAT(import_.telemetry, HasSubstr("telemetry of drive.srt: positions in subtitles at 2 "
                                           "Hz; the frames get its positions, speeds"));
  ASSERT_TRUE(frame(10).map_position);
  EXPECT_NEAR(frame(10).map_position->position.y(), 4800000.0 + 10.0, 0.2);
  EXPECT_NEAR(frame(10).map_position->position.z(), 512.5, 1e-9);
  EXPECT_NEAR(*frame(10).speed, 11.12, 0.01);  // on the earth a degree has 111.2 km
}

std::string gpx(const char* minute) {
  std::string out = "<gpx version=\"1.1\"><trk><trkseg>";
  for (int i = 0; i < 20; ++i) {
    char line[200];
    std::snprintf(line, sizeof line,
                  "<trkpt lat=\"%.6f\" lon=\"11\"><ele>500</ele><time>2024-05-01T12:%s:%02dZ</time>"
                  "</trkpt>",
                  48.0 + 1e-4 * i, minute, i);
    out += line;
  }
  return out + "</trkseg></trk></gpx>";
}

constexpr std::int64_t kMade = 1714564805;  // 2024-05-01T12:00:05Z

TEST_F(FilmTelemetry, ALogBesideTheFilmIsJoinedByWhenTheFilmWasMade) {
  write("drive.mp4", test::film_of_telemetry({}, kMade));
  write("drive.gpx", gpx("00"));
  put();
  EXPECT_THAT(import_.telemetry,
              HasSubstr("telemetry of drive.gpx: GPX at 1 Hz; joined to 1 s by when the film says "
                        "it was made (as by --telemetry-offset -5)"));
  ASSERT_TRUE(frame(10).map_position);
  EXPECT_NEAR(frame(10).map_position->position.y(), 4800000.0 + 60.0, 0.2);
  // A second of the clock is that much of the way.
  EXPECT_NEAR(frame(10).map_position->sigma, std::hypot(options_.gnss.sigma, 11.12), 0.01);
  clear();
  options_.telemetry.offset = -6.0;
  put();
  ASSERT_TRUE(frame(10).map_position);
  EXPECT_NEAR(frame(10).map_position->position.y(), 4800000.0 + 70.0, 0.2);
  EXPECT_NEAR(frame(10).map_position->sigma, options_.gnss.sigma, 1e-9);
}

TEST_F(FilmTelemetry, ALogOfAnotherTimeIsSaidAndNotUsed) {
  write("drive.mp4", test::film_of_telemetry({}, kMade));
  write("drive.gpx", gpx("30"));
  put();
  EXPECT_EQ(speeds(), 0u);
  EXPECT_THAT(import_.telemetry,
              HasSubstr("not used: its 19 s begin 1795 s after the film says it was made; "
                        "--telemetry-offset SECONDS"));
  clear();
  write("drive.mp4", test::film_of_telemetry({}));
  put();
  EXPECT_EQ(speeds(), 0u);
  EXPECT_THAT(import_.telemetry, HasSubstr("the film does not say when it was made"));
  clear();
  options_.telemetry.offset = 0.5;
  put();
  EXPECT_FALSE(frame(4).speed);
  ASSERT_TRUE(frame(15).map_position);
  EXPECT_NEAR(frame(15).map_position->position.y(), 4800000.0 + 10.0, 0.2);
}

TEST_F(FilmTelemetry, ALogOfTimesOfDayIsOfTheFilmsDay) {
  write("drive.mp4", test::film_of_telemetry({}, kMade));
  std::string log;
  for (int i = 0; i < 20; ++i) {
    char line[100];
    std::snprintf(line, sizeof line, "GPGGA,1200%02d,4800.%04d,N,01100.0000,E,1,08,0.9,500,M,,M,,",
                  i, 60 * i);
    unsigned sum = 0;
    for (const char* c = line; *c != 0; ++c) sum ^= static_cast<unsigned char>(*c);
    char end[8];
    std::snprintf(end, sizeof end, "*%02X\n", sum);
    log += "$" + std::string(line) + end;
  }
  write("drive.nmea", log);
  put();
  ASSERT_TRUE(frame(10).map_position) << import_.telemetry;
  EXPECT_NEAR(frame(10).map_position->position.y(), 4800000.0 + 60.0, 0.2);
}

TEST_F(FilmTelemetry, DamageIsOneSentenceAndTheFilmIsWhole) {
  write("drive.mp4", test::film_of_telemetry({}));
  write("drive.gpx", "<gpx><trk>");
  EXPECT_NO_THROW(put());
  EXPECT_THAT(import_.telemetry, HasSubstr("telemetry, not used: "));
  EXPECT_THAT(import_.telemetry, HasSubstr("--no-telemetry"));
  const std::string whole = test::film_of_telemetry(drive());
  const auto refused = [&](std::string bytes, const char* reason) {
    clear();
    write("drive.mp4", bytes);
    fs::remove(folder_.path() / "drive.gpx");
    EXPECT_NO_THROW(put());
    EXPECT_THAT(import_.telemetry, HasSubstr(reason));
    EXPECT_THAT(import_.telemetry, Not(HasSubstr("\n")));
    EXPECT_EQ(speeds(), 0u);
  };
  const auto at = [&](const char* what, std::size_t behind, const std::string& instead) {
    std::string out = whole;
    out.replace(out.find(what) + behind, instead.size(), instead);
    return out;
  };
  refused(at("stsz", 12, test::word(3000000)), "'stsz' of 3000000 entries");
  refused(at("stsz", 8, test::word(1000000)), "found 3 payloads in a file of");
  refused(at("stco", 12, test::word(1 << 30)), "found payload 0 of");
  refused(at("stts", 12, test::word(1)), "found times of 1 payloads, expected those of 3");
  refused(at("stsc", 16, test::word(0)), "found places of 0 payloads, expected those of 3");
  refused(at("stbl", std::size_t(0) - 4, test::word(1 << 20)), "found a box 'stbl' of 1048576");
  refused(at("mdhd", 16, test::word(0)), "found a 'mdhd' of 0 units a second");
  refused(at("GPS5", 6, "\xFF\xFF"), "found 'GPS5' of 1310700 bytes");
  refused(at("GPS5", 5, test::big_endian(19, 1)), "found 'GPS5' of the type 'l' and 19 bytes");
  refused(at("SCAL", 8, test::word(0)), "found a scale of 0");
  const auto stream = [&](const std::string& items) {
    return test::film_of_telemetry({test::payload(test::nest("STRM", items))});
  };
  const std::string words = std::string(20, '\1');
  refused(stream(test::klv("GPS5", 'l', 4, 5, words)), "found 1 fields of 'GPS5', expected 5");
  refused(stream(test::klv("SCAL", 'l', 4, 2, words.substr(0, 8)) +
                 test::klv("GPS5", 'l', 20, 1, words)),
          "found 2 scales of the 5 fields");
  refused(stream(test::klv("TYPE", 'c', 1, 3, "lUl") + test::klv("GPS9", '?', 20, 1, words)),
          "by the type 'lUl'");
  refused(stream(test::klv("TYPE", 'c', 1, 4, "f[4]") + test::klv("GRAV", '?', 20, 1, words)),
          "found 'GRAV' of 20 bytes a sample by the type 'f[4]'");
}

/// A reader of any bytes: an answer or a refusal.
TEST_F(FilmTelemetry, CutAndFlippedFilmsAreReadOrRefused) {
  const std::string whole = test::film_of_telemetry(drive("GPS9"), kMade, 200);
  const auto read = [&](const std::string& bytes) {
    write("drive.mp4", bytes);
    try {
      const auto film_boxes = read_mp4_film(film());
      if (film_boxes) read_gpmf(film(), film_boxes->telemetry);
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("found")) << error.what();
    }
  };
  for (std::size_t size = 0; size < whole.size(); size += 37) read(whole.substr(0, size));
  for (std::size_t i = 0; i < whole.size(); i += 3) {
    std::string bytes = whole;
    bytes[i] = static_cast<char>(static_cast<unsigned char>(bytes[i]) ^ (1U << (i % 8)));
    read(bytes);
    bytes[i] = static_cast<char>(0xFF);
    read(bytes);
  }
}

TEST_F(FilmTelemetry, LargeBoxesAndOffsetsHave64Bits) {
  const std::vector<std::string> payloads = drive();
  std::string film_bytes = test::film_of_telemetry(payloads);
  // The index's size in 64 bits: 8 bytes more before all payloads.
  const std::size_t moov = film_bytes.find("moov") - 4;
  const std::size_t mdat = film_bytes.find("mdat") - 4;
  const std::string body = film_bytes.substr(moov + 8, mdat - moov - 8);
  std::string wide = body;
  const std::size_t table = wide.find("stco");
  for (std::size_t i = 0; i < 3; ++i) {
    std::uint64_t offset = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      offset = (offset << 8) | static_cast<unsigned char>(wide[table + 12 + 4 * i + k]);
    }
    wide.replace(table + 12 + 4 * i, 4, test::word(static_cast<std::int64_t>(offset) + 8));
  }
  write("drive.mp4", film_bytes.substr(0, moov) + test::word(1) + "moov" +
                         test::big_endian(wide.size() + 16, 8) + wide + film_bytes.substr(mdat));
  const auto boxes = read_mp4_film(film());
  ASSERT_TRUE(boxes);
  ASSERT_EQ(boxes->telemetry.size(), 3u);
  EXPECT_EQ(read_gpmf(film(), boxes->telemetry).log.segments.front().size(), 30u);
}

GeoPoint in_subtitle(const fs::path& folder, const std::string& text) {
  std::ofstream(folder / "one.srt") << "1\n00:01:02,500 --> 00:01:03,000\n" << text << "\n\n";
  const GeoLog log = read_geo_log(folder / "one.srt");
  EXPECT_EQ(log.form, "subtitles");
  EXPECT_EQ(log.segments.front().size(), 1u) << text;
  return log.segments.front().empty() ? GeoPoint() : log.segments.front().front();
}

TEST(Subtitles, PositionsAsDronesAndDashCamerasWriteThem) {
  const test::TemporaryFolder folder;
  const auto read = [&](const std::string& text) { return in_subtitle(folder.path(), text); };
  GeoPoint point = read("[latitude : -33.8568] [longtitude : 151.2153] [altitude: 12.5]");
  EXPECT_EQ(point.time_s, 62.5);
  EXPECT_EQ(point.latitude, -33.8568);
  EXPECT_EQ(point.longitude, 151.2153);
  EXPECT_EQ(point.altitude, 12.5);
  EXPECT_TRUE(std::isnan(point.speed));
  point = read(
      "F/2.8, SS 206, ISO 150, EV 0, GPS (8.6512, 53.1423, 15), D 24.2m, H 6.0m, H.S "
      "5.5m/s, V.S 0.3m/s");
  EXPECT_EQ(point.latitude, 53.1423);
  EXPECT_EQ(point.longitude, 8.6512);
  EXPECT_NEAR(point.speed, 5.5, 1e-12);
  point = read("2024/05/01 12:00:00 N48.13743 E11.57549 72 km/h");
  EXPECT_EQ(point.latitude, 48.13743);
  EXPECT_EQ(point.longitude, 11.57549);
  EXPECT_NEAR(point.speed, 20.0, 1e-12);
  point = read("S:33.8568 W:70.6483 50 mph");
  EXPECT_EQ(point.latitude, -33.8568);
  EXPECT_EQ(point.longitude, -70.6483);
  EXPECT_NEAR(point.speed, 22.352, 1e-12);
  point = read("lat: 48.1, lon: 11.5, speed: 12.5 m/s");
  EXPECT_EQ(point.latitude, 48.1);
  EXPECT_NEAR(point.speed, 12.5, 1e-12);
}

TEST(Subtitles, WithoutAPositionTheyHaveNone) {
  const test::TemporaryFolder folder;
  for (const char* text : {"I said: go north, 12.5 miles!", "lat: 0.0 lon: 0.0", "lat: 99.5 lon: 3",
                           "GPS (n/a, n/a)", "gps"}) {
    std::ofstream(folder.path() / "one.srt") << "1\n00:00:00,000 --> 00:00:01,000\n" << text;
    EXPECT_TRUE(read_geo_log(folder.path() / "one.srt").segments.front().empty()) << text;
    EXPECT_THROW(read_speeds(folder.path() / "one.srt"), InputError);
  }
}

}  // namespace
}  // namespace camber
