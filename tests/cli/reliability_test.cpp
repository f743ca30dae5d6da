// What the program does where the machine around it fails: full disks, closed streams, signals.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "camber/image/image_io.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::ProgramResult;
using test::run_camber;
using test::run_camber_in;
using test::Surroundings;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

class Reliability : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  static std::string sample() {
    return (test::source_dir() / "samples/steep_hill/scene.json").string();
  }

  /// A level square of 40 m.
  std::string write_square(const std::string& name, std::size_t points) const {
    RoadCloud cloud;
    const CounterRandom random(3);
    cloud.points.reserve(points);
    for (std::uint64_t i = 0; i < points; ++i) {
      cloud.points.push_back(Eigen::Vector3d(random.uniform(4 * i, -20, 20),
                                             random.uniform(4 * i + 1, -20, 20),
                                             0.02 * random.normal(i))
                                 .cast<float>());
    }
    write_cloud(cloud, path(name));
    return path(name);
  }

  /// A result folder: a patch and a line along it.
  std::string make_result(const std::string& name) const {
    const std::string cloud = write_square("square.ply", 3000), line = path("line.xyz");
    std::ofstream(line) << "x y z\n-10 0 0\n0 0 0\n10 0 0\n";
    const ProgramResult result =
        run_camber({"patches", cloud, "--driven-line", line, "--out", path(name)});
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return path(name);
  }

  test::TemporaryFolder folder_;
};

TEST_F(Reliability, ResultsThatStandardOutputDoesNotTakeAreAFailure) {
  const std::string cloud = write_square("cloud.ply", 3000), result = make_result("result");
  const std::string road = path("road"), labels = path("labels.txt"),
                    calibration = path("calib.txt");
  const std::string images = (fs::path(sample()).parent_path() / "image").string();
  ASSERT_EQ(run_camber({"reconstruct", sample(), "--no-pictures", "--out", road}).exit_code, 0);
  ASSERT_EQ(run_camber({"vehicles", sample(), "--surface", road, "--out", path("vehicles.json"),
                        "--kitti-labels", labels})
                .exit_code,
            0);
  std::ofstream(calibration) << "P2: 720 0 620 0 0 720 170 0 0 0 1 0\n";
  Surroundings full, closed;
  full.standard_output = "/dev/full";
  closed.shell = "exec >&-";
  const std::vector<std::vector<std::string>> commands = {
      {"--version"},
      {"--help"},
      {"plane", "--help"},
      {"plane", cloud},
      {"plane", cloud, "--json"},
      {"info", cloud},
      {"info", cloud, "--json"},
      {"info", result},
      {"patches", cloud, "--out", path("patches")},
      {"ground", cloud, "--out", path("ground.ply"), "--json"},
      {"profile", result, "--json"},
      {"compare", cloud, cloud},
      {"convert", cloud, "--out", path("x.pcd"), "--json"},
      {"filter", cloud, "--voxel", "1", "--out", path("y.pcd"), "--json"},
      {"prior", "info"},
      {"prior", "info", "--json"},
      {"synth", "--frames", "1", "--size", "160x64", "--out", path("scene"), "--json"},
      {"vehicles", sample(), "--frames", "0", "--out", path("vehicles.json"), "--json"},
      {"reconstruct", sample(), "--no-pictures", "--out", road, "--json", "--quiet"},
      {"triangulate", sample(), "--out", path("road.ply"), "--json", "--quiet"},
      {"evaluate", "--truth", sample(), "--estimate", road},
      {"evaluate", "--truth", sample(), "--estimate", road, "--json"},
      {"render", result, "--out", path("picture.png")},
      {"render", result, "--out", path("picture.png"), "--json"},
      {"lift", labels, "--surface", road, "--calib", calibration, "--out", path("l.txt"), "--json"},
      {"export", road, "--to", "trajectory", "--out", path("road.tum"), "--json"},
      {"detect", sample(), "--frames", "0", "--keypoints", "shipped", "--out", path("detected"),
       "--json", "--quiet"},
      {"import", "images", images, "--fov", "80", "--out", path("imported"), "--json", "--quiet"},
      {"keypoints", "synthesise", "--count", "2", "--out", path("crops"), "--json", "--quiet"},
      {"keypoints", "run", path("crops"), "--json"},
      {"keypoints", "evaluate", path("crops")},
  };
  for (const auto& command : commands) {
    SCOPED_TRACE(::testing::PrintToString(command));
    EXPECT_ONE_SENTENCE(run_camber_in(full, command), 3, "standard output cannot be written");
    EXPECT_ONE_SENTENCE(run_camber_in(closed, command), 3, "standard output cannot be written");
  }
  // A failure stays what it is.
  EXPECT_ONE_SENTENCE(run_camber_in(full, {"plane", path("none.ply")}), 2, "none.ply");
}

TEST_F(Reliability, AFileNeverTakesThePlaceOfAClosedStream) {
  // With standard error closed a message would else end in the file that is being written.
  const std::string cloud = write_square("cloud.ply", 3000);
  Surroundings closed;
  closed.shell = "exec 2>&- 1>&- 0<&-";
  for (const char* out : {"a.ply", "b.ply"}) {
    run_camber_in(out[0] == 'a' ? Surroundings() : closed,
                  {"convert", cloud, "--out", path(out), "--json"});
  }
  EXPECT_EQ(test::read_bytes(path("b.ply")), test::read_bytes(path("a.ply")));
  EXPECT_GT(fs::file_size(path("b.ply")), 3000u);
}

TEST_F(Reliability, AFileBeyondTheLargestSizeIsARefusal) {
  const std::string cloud = write_square("cloud.ply", 3000), result = make_result("result");
  const auto before = test::snapshot(folder_.path());
  Surroundings small;
  small.shell = "ulimit -f 1";  // 512 or 1024 bytes
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"convert", cloud, "--out", path("x.pcd")},
           {"profile", result, "--out", path("profile.csv")},
           {"patches", cloud, "--out", path("result")},
           {"vehicles", sample(), "--out", path("vehicles.json")}}) {
    SCOPED_TRACE(::testing::PrintToString(command));
    const ProgramResult failed = run_camber_in(small, command);
    EXPECT_ONE_SENTENCE(failed, 3, "File too large");
    EXPECT_THAT(failed.error, ::testing::Not(HasSubstr(".camber."))) << "a temporary name";
  }
  EXPECT_TRUE(test::snapshot(folder_.path()) == before) << "a file is another, or more are there";
}

TEST_F(Reliability, ShortMemoryIsARefusalThatNamesIt) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "the address sanitizer takes memory and time of its own";
#endif
  const std::string result = make_result("result");
  const auto before = test::snapshot(folder_.path());
  int refused = 0;
  for (const int megabytes : {100, 220, 400, 550, 700, 850, 950, 1050}) {
    for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
             {"render", result, "--view", "oblique", "--out", path("picture.png")},
             {"reconstruct", sample(), "--out", path("hill")},
             {"patches", path("square.ply"), "--out", path("patches")}}) {
      if (command[0] == "reconstruct" && megabytes != 220 && megabytes != 950) continue;  // slow
      SCOPED_TRACE(command[0] + " " + std::to_string(megabytes));
      Surroundings small;
      small.shell = "ulimit -v " + std::to_string(1000 * megabytes);
      const ProgramResult run = run_camber_in(small, command);
      if (run.exit_code == 0) {
        fs::remove_all(command.back());
        continue;
      }
      ++refused;
      EXPECT_ONE_SENTENCE(run, 3, "memory");
      EXPECT_TRUE(test::snapshot(folder_.path()) == before);
    }
  }
  EXPECT_GE(refused, 8);
}

TEST_F(Reliability, NumbersBeyondTheirRangeAreAMistakeOfTheCaller) {
  for (const char* frames_per_second : {"1e-320", "1e308"}) {
    EXPECT_ONE_SENTENCE(run_camber({"synth", "--frames", "1", "--size", "160x64", "--hz",
                                    frames_per_second, "--out", path("scene")}),
                        2, "frame_rate");
  }
  for (const char* intrinsics : {"1e308,1e308,80,32", "100,100,1e200,32", "1e-320,1e-320,80,32"}) {
    EXPECT_ONE_SENTENCE(run_camber({"synth", "--frames", "1", "--size", "160x64", "--intrinsics",
                                    intrinsics, "--out", path("scene")}),
                        2, "camera");
  }
  EXPECT_FALSE(fs::exists(path("scene")));
}

TEST_F(Reliability, APriorBeyondTheRangeIsAMistakeOfTheCaller) {
  const std::string text =
      test::read_bytes(test::source_dir() / "lib/camber/vehicle/shipped_prior.json");
  for (const char* number : {"1e309", "1e308", "-1e155"}) {
    std::string changed = text;
    const std::size_t at = changed.find("\"covariance\": [") + 15;
    changed.replace(at, changed.find(',', at) - at, number);
    test::write_bytes(path("prior.json"), changed);
    EXPECT_ONE_SENTENCE(
        run_camber({"vehicles", sample(), "--prior", path("prior.json"), "--out", path("v.json")}),
        2, "prior.json: ");
    EXPECT_ONE_SENTENCE(run_camber({"prior", "info", path("prior.json")}), 2, "prior.json: ");
  }
}

TEST_F(Reliability, AMessageIsOneLineWhateverItNames) {
  const std::string cloud = write_square("cloud.ply", 100);
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"a\nb"},
           {"--version", "a\nb"},
           {"plane", "a\nb"},
           {"plane", cloud, "a\nb"},
           {"plane", cloud, "--threshold", "a\nb"},
           {"plane", cloud, "--seed", "a\nb"},
           {"plane", cloud, "--config", "a\nb"},
           {"render", cloud, "--out", path("x.png"), "--size", "a\nb"},
       }) {
    SCOPED_TRACE(::testing::PrintToString(command));
    EXPECT_ONE_SENTENCE(run_camber(command), 2, "a?b");
  }
}

TEST_F(Reliability, ANameThatTheSystemDoesNotTakeIsAMistakeOfTheCaller) {
  const std::string name(20000, '9');
  EXPECT_ONE_SENTENCE(run_camber({"reconstruct", sample(), "--out", name}), 2,
                      "999...: File name too long");
  EXPECT_ONE_SENTENCE(run_camber({"evaluate", "--truth", sample(), "--estimate", name}), 2,
                      "999...: File name too long");
}

TEST_F(Reliability, NoOutputReplacesAnInput) {
  const std::string cloud = write_square("cloud.ply", 3000), result = make_result("result");
  const std::string line = path("line.xyz");
  fs::copy(fs::path(sample()).parent_path(), path("scene"), fs::copy_options::recursive);
  const std::string scene = path("scene/scene.json");
  fs::create_hard_link(cloud, path("hard.ply"));
  fs::create_symlink(cloud, path("soft.ply"));
  fs::create_symlink(scene, path("soft.json"));
  fs::copy_file(test::source_dir() / "lib/camber/vehicle/shipped_prior.json", path("prior.json"));
  const auto before = test::snapshot(folder_.path());
  const std::string folder = folder_.path().string();
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"filter", cloud, "--voxel", "1", "--out", cloud},
           {"filter", cloud, "--voxel", "1", "--out", path("hard.ply")},
           {"convert", cloud, "--out", path("soft.ply")},
           {"convert", path("soft.ply"), "--out", folder + "/./cloud.ply"},
           {"ground", cloud, "--out", path("hard.ply")},
           {"profile", result, "--out", result + "/surface.json"},
           {"profile", result, "--along", line, "--out", path("result/../result/run.json")},
           {"vehicles", scene, "--out", scene},
           {"vehicles", path("scene"), "--out", path("soft.json")},
           {"vehicles", scene, "--out", path("scene/image/000000.png")},
           {"vehicles", scene, "--prior", path("prior.json"), "--out", path("prior.json")},
           {"vehicles", scene, "--out", path("v.json"), "--kitti-labels", scene},
           {"triangulate", scene, "--out", path("scene/truth/road.ply")},
           {"render", result, "--out", path("scene/image/000000.png"), "--scene", scene},
           {"prior", "info", path("prior.json"), "--picture", path("prior.json")},
       }) {
    SCOPED_TRACE(::testing::PrintToString(command));
    EXPECT_ONE_SENTENCE(run_camber(command), 2, "is the input");
    EXPECT_TRUE(test::snapshot(folder_.path()) == before) << "a file is another, or more are there";
  }
  // Beside them there is room.
  EXPECT_EQ(run_camber({"profile", result, "--out", result + "/profile.csv"}).exit_code, 0);
  EXPECT_EQ(run_camber({"profile", result, "--out", result + "/profile.csv"}).exit_code, 0);
}

TEST_F(Reliability, NoOutputReplacesAFileThatAnOptionNames) {
  const std::string cloud = write_square("cloud.ply", 3000), result = make_result("result");
  fs::copy(fs::path(sample()).parent_path(), path("scene"), fs::copy_options::recursive);
  fs::create_directory(path("boxes"));
  for (const char* file : {"c.ply", "c.json", "c.csv", "c.png", "c.txt", "c.crg",
                           "boxes/scene.json", "result/c.toml", "result/crs.txt", "scene/c.toml"}) {
    std::ofstream(path(file)) << "quiet = true\n";
  }
  fs::create_symlink(cloud, path("result/link.ply"));
  fs::create_symlink(path("c.json"), path("link.json"));
  const auto before = test::snapshot(folder_.path());
  const std::string scene = path("scene"), images = path("scene/image"), json = path("c.json");
  const std::string coordinates = path("c.csv"), boxes = path("boxes/scene.json");
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"filter", cloud, "--voxel", "1", "--config", path("c.ply"), "--out", path("c.ply")},
           {"convert", cloud, "--crs", coordinates, "--out", coordinates},
           {"convert", cloud, "--config", coordinates, "--out", coordinates},
           {"ground", cloud, "--config", path("c.ply"), "--out", path("c.ply")},
           {"profile", result, "--config", coordinates, "--out", coordinates},
           {"profile", result, "--config", path("c.png"), "--plot", path("c.png")},
           {"export", result, "--to", "opencrg", "--config", path("c.crg"), "--out", path("c.crg")},
           {"render", result, "--config", path("c.png"), "--out", path("c.png")},
           {"view", result, "--config", path("c.png"), "--picture", path("c.png")},
           {"lift", path("c.txt"), "--surface", result, "--calib", path("c.txt"), "--out",
            path("c.txt")},
           {"vehicles", scene, "--config", json, "--out", json},
           {"vehicles", scene, "--config", path("link.json"), "--out", json},
           {"vehicles", scene, "--config", json, "--out", path("link.json")},
           {"triangulate", scene, "--config", path("c.ply"), "--out", path("c.ply")},
           {"detect", scene, "--config", json, "--out", json},
           {"prior", "learn", "--family", "--config", json, "--out", json},
           {"prior", "info", "--config", path("c.png"), "--picture", path("c.png")},
           {"keypoints", "run", scene, "--config", json, "--out", json},
           {"keypoints", "evaluate", scene, "--config", path("c.png"), "--plot", path("c.png")},
           {"keypoints", "synthesise", "--config", path("c.png"), "--sheet", path("c.png")},
           {"import", "images", images, "--fov", "80", "--config", json, "--out", json},
           {"import", "images", images, "--fov", "80", "--detections", json, "--out", json},
           {"import", "images", images, "--fov", "80", "--detections", boxes, "--out",
            path("boxes")},
           {"import", "video", path("c.txt"), "--calib", json, "--out", json},
           {"import", "colmap", scene, "--images", images, "--detections", json, "--out", json},
           {"import", "rosbag", path("c.txt"), "--poses", json, "--out", json},
           {"import", "kitti", "--images", images, "--keypoints", json, "--out", json},
           {"import", "synthia-sf", "--sequence", scene, "--config", json, "--out", json},
       }) {
    SCOPED_TRACE(::testing::PrintToString(command));
    EXPECT_ONE_SENTENCE(run_camber(command), 2, "is the input");
    EXPECT_TRUE(test::snapshot(folder_.path()) == before) << "a file is another, or more are there";
  }
  const std::string config = path("result/c.toml");
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"patches", cloud, "--config", config, "--out", result},
           {"patches", cloud, "--crs", path("result/crs.txt"), "--out", result},
           {"patches", path("result/link.ply"), "--out", result},
           {"compare", cloud, cloud, "--config", config, "--out", result},
           {"evaluate", "--truth", scene, "--estimate", json, "--subset", config, "--out", result},
           {"reconstruct", scene, "--config", config, "--out", result},
           {"synth", "--config", path("scene/c.toml"), "--overwrite", "--out", scene},
           {"keypoints", "synthesise", "--config", config, "--out", result},
       }) {
    SCOPED_TRACE(::testing::PrintToString(command));
    EXPECT_ONE_SENTENCE(run_camber(command), 2, "holds the input");
    EXPECT_TRUE(test::snapshot(folder_.path()) == before) << "a file is another, or more are there";
  }
}

TEST_F(Reliability, AnImportMayBeRepeated) {
  const std::string drive = path("drive");
  fs::copy(fs::path(sample()).parent_path() / "image", drive);
  for (int i = 0; i < 2; ++i) {
    const ProgramResult result =
        run_camber({"import", "images", drive, "--fov", "80", "--out", drive});
    EXPECT_EQ(result.exit_code, 0) << result.error;
  }
}

TEST_F(Reliability, ConvertedMasksDoNotReplaceThoseThatTheyAreMadeOf) {
  const std::string masks = path("scene/segmentation");
  fs::create_directories(masks);
  const fs::path image = fs::path(sample()).parent_path() / "image";
  const Image color = read_color_image(image / "000000.png");
  for (const char* name : {"000000.png", "000001.png", "000002.png"}) {
    Image mask{color.width, color.height, 3,
               std::vector<std::uint8_t>(3 * static_cast<std::size_t>(color.width) *
                                         static_cast<std::size_t>(color.height))};
    for (std::size_t i = 0; i < mask.data.size(); i += 3) {  // KITTI's road
      mask.data[i] = mask.data[i + 2] = 255;
    }
    write_png(mask, fs::path(masks) / name);
  }
  const auto before = test::snapshot(folder_.path());
  const std::vector<std::string> command = {"import",     "images",  image.string(), "--fov",
                                            "80",         "--masks", masks,          "--class-map",
                                            "kitti-road", "--out"};
  std::vector<std::string> onto = command, beside = command;
  onto.push_back(path("scene"));
  EXPECT_ONE_SENTENCE(run_camber(onto), 2, "is the input");
  EXPECT_TRUE(test::snapshot(folder_.path()) == before) << "a file is another, or more are there";
  beside.push_back(path("beside"));
  const ProgramResult result = run_camber(beside);
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_TRUE(fs::exists(path("beside/segmentation/000001.png")));
}

TEST_F(Reliability, TwoOutputsAreTwoFiles) {
  fs::create_symlink(path("q.json"), path("link.json"));
  std::ofstream(path("q.json")) << "{}";
  const auto before = test::snapshot(folder_.path());
  const std::string q = path("q.json"), crops = path("crops");
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"vehicles", sample(), "--out", q, "--kitti-labels", q},
           {"vehicles", sample(), "--out", q, "--kitti-labels", path("link.json")},
           {"vehicles", sample(), "--out", path("l.tilt.csv"), "--kitti-labels", path("l.txt")},
           {"vehicles", sample(), "--out", path("new.json"), "--kitti-labels", path("./new.json")},
           {"keypoints", "evaluate", crops, "--out", q, "--plot", q},
           {"profile", crops, "--out", path("link.json"), "--plot", q},
       }) {
    SCOPED_TRACE(::testing::PrintToString(command));
    EXPECT_ONE_SENTENCE(run_camber(command), 2, "expected two");
    EXPECT_TRUE(test::snapshot(folder_.path()) == before) << "a file is another, or more are there";
  }
}

TEST_F(Reliability, SignalsEndLongLoopsWithinASecond) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "the address sanitizer takes memory and time of its own";
#endif
  const std::string cloud = write_square("cloud.ply", 1'500'000);
  const auto before = test::snapshot(folder_.path());
  const std::vector<std::vector<std::string>> commands = {
      {"compare", cloud, cloud, "--out", path("compared")},
      {"filter", cloud, "--normals", "40", "--out", path("normals.ply")},
      {"convert", cloud, "--out", path("copy.csv")},
      {"patches", cloud, "--out", path("patches")},
      {"synth", "--frames", "20", "--out", path("scene")},
  };
  int interrupted = 0;
  for (const auto& command : commands) {
    for (const int after : {150, 700}) {
      SCOPED_TRACE(::testing::PrintToString(command) + " " + std::to_string(after));
      Surroundings stopped;
      stopped.signal = SIGTERM;
      stopped.signal_after_ms = after;
      const ProgramResult result = run_camber_in(stopped, command);
      if (result.exit_code == 0) {  // a fast machine
        fs::remove_all(command.back());
        continue;
      }
      if (result.exit_code == 128 + SIGTERM) {  // a slow one: its libraries were not loaded yet
        EXPECT_EQ(after, 150);
      } else {
        EXPECT_ONE_SENTENCE(result, 130, "interrupted");
        ++interrupted;
      }
      EXPECT_LT(result.seconds_after_signal, 2.0);  // 1 s on a machine that does nothing else
      EXPECT_TRUE(test::snapshot(folder_.path()) == before)
          << "a file is another, or more are there";
    }
  }
  EXPECT_GE(interrupted, 4);
}

TEST_F(Reliability, TheSecondSignalDoesNotWait) {
  // A pipe that nobody writes: opening it never ends by itself.
  const std::string pipe = path("pipe.json");
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  const std::vector<std::string> command = {"vehicles", pipe, "--out", path("vehicles.json")};
  Surroundings stopped;
  stopped.signal = SIGTERM;
  stopped.signal_after_ms = 500;
  const ProgramResult once = run_camber_in(stopped, command);
  EXPECT_ONE_SENTENCE(once, 130, "interrupted");
  EXPECT_GT(once.seconds_after_signal, 0.5);
  stopped.shell = "(sleep 0.7; kill -TERM $$) & :";
  const ProgramResult twice = run_camber_in(stopped, command);
  EXPECT_ONE_SENTENCE(twice, 130, "interrupted");
  EXPECT_LT(twice.seconds_after_signal, 0.6);
}

/// The environment of a command that waits for a pipe, as it is after half a second.
std::string environment_of_waiting_command(const std::string& pipe, const std::string& file,
                                           Surroundings surroundings) {
  surroundings.shell += "(sleep 0.5; tr '\\0' '\\n' < /proc/$$/environ > " + file + ") & :";
  surroundings.signal = SIGTERM;
  surroundings.signal_after_ms = 1000;
  EXPECT_EQ(run_camber_in(surroundings, {"vehicles", pipe, "--out", file + ".json"}).exit_code,
            130);
  const std::string found = test::read_text(file);
  EXPECT_THAT(found, HasSubstr("PATH="));
  return found;
}

TEST_F(Reliability, MemoryIsAskedForInHugePagesWhereAddressSpaceIsNotLimited) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "instrumented programs have allocators of their own";
#endif
  std::ifstream kernel("/sys/kernel/mm/transparent_hugepage/enabled");
  std::string given;
  std::getline(kernel, given);
  if (given.find("[madvise]") == std::string::npos) {
    GTEST_SKIP() << "huge pages are not given on request here: " << given;
  }
  const std::string pipe = path("pipe.json"), file = path("environment");
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  const char* const asked = "GLIBC_TUNABLES=glibc.malloc.hugetlb=1";
  EXPECT_THAT(environment_of_waiting_command(pipe, file, {}), HasSubstr(asked));
  Surroundings limited;
  limited.shell = "ulimit -v 4000000; ";
  EXPECT_THAT(environment_of_waiting_command(pipe, file, limited), Not(HasSubstr(asked)));
  Surroundings own;
  own.variables = {"GLIBC_TUNABLES=glibc.malloc.check=0"};
  EXPECT_THAT(environment_of_waiting_command(pipe, file, own), Not(HasSubstr(asked)));
}

}  // namespace
}  // namespace camber
