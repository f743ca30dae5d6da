// samples/cluster: the steps of tiles by Snakemake (where it is installed), and a Slurm script's
// tasks as Slurm starts them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>

#include "camber/cloud/cloud_io.h"
#include "cli/run_program.h"
#include "support/test_data.h"
#include "tiles/made_survey.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using test::run_camber;

class Cluster : public ::testing::Test {
 protected:
  void SetUp() override {
    const RoadCloud cloud = test::made_survey(160.0, 2.0);
    write_cloud(test::strip_of(cloud, 0.0, 90.0), path("west.laz"));
    write_cloud(test::strip_of(cloud, 90.0, 200.0), path("east.laz"));
    std::ofstream(path("clouds.txt")) << path("west.laz") << "\n" << path("east.laz") << "\n";
    std::ofstream(path("line.csv")) << "x,y\n651010,6270020\n651150,6270030\n";
    must({"tiles", "plan", path("west.laz"), path("east.laz"), "--tile", "60", "--out",
          path("alone")});
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  static void must(const std::vector<std::string>& words) {
    const auto result = run_camber(words);
    ASSERT_EQ(result.exit_code, 0) << result.error;
  }
  /// A line for the shell, in the folder, with the program on PATH.
  int shell(const std::string& line) const {
    const std::string programs = fs::path(CAMBER_PROGRAM).parent_path().string();
    const int status = std::system(("cd '" + folder_.path().string() +
                                    "' && export XDG_CACHE_HOME=\"$PWD\" PATH='" + programs +
                                    "':\"$PATH\" && " + line + " >log 2>&1 </dev/null")
                                       .c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string log() const { return test::read_text(folder_.path() / "log"); }
  static std::string sample(const std::string& name) {
    return "'" + (test::source_dir() / "samples/cluster" / name).string() + "'";
  }
  std::map<std::string, std::string> files(const std::string& name) const {
    return test::files_below(path(name));
  }

  test::TemporaryFolder folder_;
};

TEST_F(Cluster, SnakemakeGivesTheFilesOfTheStepsAlone) {
  if (shell("snakemake --version") != 0) GTEST_SKIP() << "snakemake is not installed";
  const std::string run = "snakemake -s " + sample("tiles.smk") +
                          " --cores 2 --config list=clouds.txt out=plan threads=1 "
                          "plan_options='--tile 60' ";
  // Ground comes before what stands on it, patches before labels.
  ASSERT_EQ(shell(run + "job=profile run_options='--along line.csv' "
                        "join_options='--along line.csv --crown'"),
            0)
      << log();
  ASSERT_EQ(shell(run + "job=labels"), 0) << log();
  for (const char* const job : {"ground", "patches", "labels"}) {
    must({"tiles", "run", path("alone"), "--job", job});
    must({"tiles", "join", path("alone"), "--job", job});
  }
  must({"tiles", "run", path("alone"), "--job", "profile", "--along", path("line.csv")});
  must(
      {"tiles", "join", path("alone"), "--job", "profile", "--along", path("line.csv"), "--crown"});
  auto alone = files("alone"), plan = files("plan");
  // Times of computing, and the command line.
  for (auto* const all : {&alone, &plan}) {
    all->erase("patches/run.json");
    all->erase("profile/profile.json");
  }
  EXPECT_EQ(plan, alone);
  // What is done stays as it is.
  ASSERT_EQ(shell(run + "job=labels"), 0) << log();
  EXPECT_THAT(log(), testing::HasSubstr("Nothing to be done"));
}

TEST_F(Cluster, TasksOfAnArrayGiveTheFilesOfTheStepsAlone) {
  must(
      {"tiles", "plan", path("west.laz"), path("east.laz"), "--tile", "60", "--out", path("plan")});
  for (const char* const task : {"2", "1", "3"}) {
    ASSERT_EQ(shell(std::string("SLURM_ARRAY_TASK_COUNT=3 SLURM_CPUS_PER_TASK=1 "
                                "SLURM_ARRAY_TASK_ID=") +
                    task + " bash " + sample("tiles.sbatch") + " plan ground"),
              0)
        << log();
  }
  must({"tiles", "run", path("alone"), "--job", "ground"});
  for (const char* const name : {"plan", "alone"}) {
    must({"tiles", "join", path(name), "--job", "ground"});
  }
  EXPECT_EQ(files("plan"), files("alone"));
  // A task that fails says so to Slurm, which then does not start the join.
  fs::remove(path("plan/ground") + "/index.json");
  fs::resize_file(path("plan/index.json"), 10);
  EXPECT_EQ(shell("SLURM_ARRAY_TASK_COUNT=1 SLURM_ARRAY_TASK_ID=1 bash " + sample("tiles.sbatch") +
                  " plan ground"),
            2);
}

}  // namespace
}  // namespace camber
