// A write, an fsync or a rename that fails, and a kill at a rename, at each call of each command:
// the old result or the new one, whole, under its name.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::ProgramResult;
using test::run_camber;
using test::run_camber_in;
using test::snapshot;
using test::Surroundings;
namespace fs = std::filesystem;

constexpr int kMostCalls = 200;  // of a kind; the commands make fewer

class Faults : public ::testing::Test {
 protected:
  Faults() {
    RoadCloud cloud;
    const CounterRandom random(3);
    for (std::uint64_t i = 0; i < 2000; ++i) {
      cloud.points.push_back(Eigen::Vector3d(random.uniform(4 * i, -20, 20),
                                             random.uniform(4 * i + 1, -20, 20),
                                             0.02 * random.normal(i))
                                 .cast<float>());
    }
    write_cloud(cloud, path("cloud.ply"));
    for (Eigen::Vector3f& point : cloud.points) point.z() += 1.0f;
    write_cloud(cloud, path("other.ply"));
    commands_ = {
        {"convert", path("cloud.ply"), "--out", path("out.csv")},
        {"ground", path("cloud.ply"), "--out", path("out.ply")},
        {"patches", path("cloud.ply"), "--out", path("out")},
        {"vehicles", sample(), "--frames", "0", "--out", path("out.json"), "--kitti-labels",
         path("out.txt")},
    };
  }

  static std::string sample() {
    return (test::source_dir() / "samples/steep_hill/scene.json").string();
  }
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }

  static Surroundings fault(const std::string& kind, int call) {
    Surroundings out;
    out.variables = {std::string("LD_PRELOAD=") + CAMBER_FAULT_SHIM,
                     "CAMBER_FAULT=" + kind + ":" + std::to_string(call)};
    return out;
  }

  test::TemporaryFolder folder_;
  std::vector<std::vector<std::string>> commands_;
};

TEST_F(Faults, AFailingCallLeavesTheOldResultAndNothingElse) {
  for (const auto& command : commands_) {
    ASSERT_EQ(run_camber(command).exit_code, 0);  // the old result
    for (const char* kind : {"write", "fsync", "rename"}) {
      const auto before = snapshot(folder_.path());
      int call = 1;
      for (; call < kMostCalls; ++call) {
        SCOPED_TRACE(command[0] + " " + kind + " " + std::to_string(call));
        const ProgramResult result = run_camber_in(fault(kind, call), command);
        // An exchange that fails may be made up for by a rename.
        if (result.exit_code == 0) break;
        EXPECT_ONE_SENTENCE(result, 3, "camber: ");
        EXPECT_THAT(result.error, ::testing::Not(::testing::HasSubstr(".camber.")));
        EXPECT_TRUE(snapshot(folder_.path()) == before);
      }
      EXPECT_LT(call, kMostCalls);
      EXPECT_TRUE(call > 1 || std::string(kind) == "rename") << "the shim was not loaded";
    }
  }
}

TEST_F(Faults, AKilledRunLeavesAWholeResultAndTheNextOneClearsUp) {
  for (const bool exchange : {true, false}) {
    const std::vector<std::string> old = {"patches", path("other.ply"), "--out", path("out")};
    std::vector<std::string> next = old;
    next[1] = path("cloud.ply");
    ASSERT_EQ(run_camber(next).exit_code, 0);
    const std::string new_labels = test::read_bytes(path("out/labels.ply"));
    int call = 1;
    for (; call < 10; ++call) {
      SCOPED_TRACE(call);
      ASSERT_EQ(run_camber(old).exit_code, 0);
      const auto before = snapshot(folder_.path());
      Surroundings killed = fault("kill", call);
      if (!exchange) killed.variables.emplace_back("CAMBER_NO_EXCHANGE=1");
      const ProgramResult result = run_camber_in(killed, next);
      if (result.exit_code == 0) break;
      EXPECT_EQ(result.exit_code, 128 + SIGKILL);
      // Under its name, or the one that the documentation gives.
      const std::string name = fs::exists(path("out")) ? "out" : ".out.camber-old";
      const std::string labels = test::read_bytes(path(name + "/labels.ply"));
      EXPECT_TRUE(labels == before.at("out/labels.ply") || labels == new_labels);
      for (const char* file : {"/surface.json", "/run.json"}) {
        EXPECT_TRUE(fs::exists(path(name + file)));
      }
      ASSERT_EQ(run_camber(next).exit_code, 0);
      EXPECT_EQ(snapshot(folder_.path()).size(), before.size()) << "something is left";
      EXPECT_EQ(test::read_bytes(path("out/labels.ply")), new_labels);
    }
    EXPECT_GT(call, 1);
    EXPECT_LT(call, 10);
  }
}

}  // namespace
}  // namespace camber
