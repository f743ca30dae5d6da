// samples/cluster: the steps of tiles by Snakemake (where it is installed), a Slurm script's tasks
// as Slurm starts them, and (with CAMBER_LONG_TESTS) by a Slurm of this machine alone.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

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

class OnSlurm : public Cluster {
 protected:
  void TearDown() override {
    if (!slurm_.empty()) shell(slurm_ + " stop slurm");
  }
  static bool is_long_run() {
    const char* const asked = std::getenv("CAMBER_LONG_TESTS");
    return asked && std::string(asked) == "1";
  }
  /// Exit code 77 where Slurm cannot be started; log() says why.
  int start() {
    slurm_ = "'" + (test::source_dir() / "tests/cli/one_node_slurm.sh").string() + "'";
    return shell(slurm_ + " start slurm");
  }
  /// A line of a user of Slurm.
  void slurm(const std::string& line) const {
    ASSERT_EQ(shell("export SLURM_CONF=\"$PWD/slurm/slurm.conf\" && { " + line + "; }"), 0)
        << line << "\n"
        << log() << test::read_text(path("slurm/slurmctld.log"));
  }
  /// An array of four tasks, and the join after it: their numbers are in tasks and join.
  static std::string submit(const std::string& plan) {
    return "tasks=$(sbatch --parsable --array=1-4 --output=task-%A-%a " + sample("tiles.sbatch") +
           " " + plan + " ground) && join=$(sbatch --parsable --dependency=afterok:$tasks " +
           "--kill-on-invalid-dep=yes --wrap 'camber tiles join " + plan +
           " --job ground') && echo $tasks >tasks && echo $join >join";
  }
  /// Until no job waits or runs.
  static std::string wait() {
    return "for k in $(seq 1200); do [ -n \"$(squeue -h)\" ] || break; sleep 0.2; done && "
           "squeue && [ -z \"$(squeue -h)\" ]";
  }
  /// What scontrol says of a job.
  std::string job(const std::string& number) const {
    slurm("scontrol show job " + number);
    return log();
  }
  std::string number(const std::string& file) const {
    const std::string line = test::read_text(path(file));
    return line.substr(0, line.find('\n'));
  }

 private:
  std::string slurm_;
};

/// Skips the test, saying why, where it would take too long or Slurm cannot be started.
#define CAMBER_START_SLURM()                                             \
  do {                                                                   \
    if (!is_long_run()) GTEST_SKIP() << "long, for tests/run.sh --long"; \
    const int started = start();                                         \
    if (started == 77) GTEST_SKIP() << log();                            \
    ASSERT_EQ(started, 0) << log();                                      \
  } while (false)

TEST_F(OnSlurm, StoppedTasksAreRepeatedAndFailedOnesKeepTheJoinFromRunning) {
  CAMBER_START_SLURM();
  // Tasks of some seconds.
  write_cloud(test::made_survey(400.0, 6.0), path("whole.laz"));
  for (const char* const name : {"alone", "plan", "broken"}) {
    must({"tiles", "plan", path("whole.laz"), "--tile", "60", "--out", path(name), "--overwrite"});
  }
  // A tile of the second task, which has several.
  must({"tiles", "run", path("alone"), "--job", "ground", "--shard", "2/4"});
  const auto index = nlohmann::json::parse(test::read_text(path("plan/index.json")));
  std::string second;
  int tiles = 0;
  for (const auto& tile : index["tiles"]) {
    const std::string name = tile["name"];
    if (!fs::exists(path("alone/ground/" + name + ".json"))) continue;
    if (second.empty()) second = name;
    ++tiles;
  }
  ASSERT_GT(tiles, 2);
  must({"tiles", "run", path("alone"), "--job", "ground"});
  must({"tiles", "join", path("alone"), "--job", "ground"});

  // One task is stopped once it has done a tile.
  slurm(submit("plan") + " && for k in $(seq 1200); do [ ! -e 'plan/ground/" + second +
        ".json' ] || break; sleep 0.05; done && scancel --batch --signal=TERM ${tasks}_2 && " +
        wait());
  EXPECT_THAT(job(number("tasks") + "_2"), testing::AllOf(testing::HasSubstr("JobState=COMPLETED"),
                                                          testing::HasSubstr("Restarts=1")));
  EXPECT_THAT(job(number("join")), testing::HasSubstr("JobState=COMPLETED"));
  EXPECT_EQ(files("plan"), files("alone"));

  // One task cannot write a tile.
  must({"tiles", "run", path("broken"), "--job", "ground", "--tile", "0"});
  fs::create_directories(path("broken/ground/" + second + ".laz"));
  slurm(submit("broken") + " && " + wait());
  EXPECT_THAT(job(number("tasks") + "_2"), testing::HasSubstr("JobState=FAILED"));
  for (const char* const task : {"_1", "_3", "_4"}) {
    EXPECT_THAT(job(number("tasks") + task), testing::HasSubstr("JobState=COMPLETED"));
  }
  EXPECT_THAT(job(number("join")), testing::HasSubstr("JobState=CANCELLED"));
  EXPECT_FALSE(fs::exists(path("broken/ground/index.json")));
  fs::remove(path("broken/ground/" + second + ".laz"));
  slurm(submit("broken") + " && " + wait());
  EXPECT_THAT(job(number("join")), testing::HasSubstr("JobState=COMPLETED"));
  EXPECT_EQ(files("broken"), files("alone"));
}

TEST_F(OnSlurm, SnakemakesProfileGivesTheFilesOfTheStepsAlone) {
  if (shell("snakemake --version") != 0) GTEST_SKIP() << "snakemake is not installed";
  CAMBER_START_SLURM();
  const std::string run =
      "timeout 600 snakemake --profile " + sample("slurm") + " -s " + sample("tiles.smk") +
      " --config list=clouds.txt out=plan threads=1 plan_options='--tile 60' job=ground";
  slurm(run);
  must({"tiles", "run", path("alone"), "--job", "ground"});
  must({"tiles", "join", path("alone"), "--job", "ground"});
  EXPECT_EQ(files("plan"), files("alone"));
  // Jobs that fail are known as failed, and the join is not run.
  fs::remove_all(path("plan/ground"));
  fs::create_directory(path("plan/ground"));
  std::ofstream(path("plan/ground/notes")) << "not of tiles";
  slurm("{ " + run + "; [ $? -eq 1 ]; }");
  EXPECT_FALSE(fs::exists(path("plan/ground/index.json")));
}

}  // namespace
}  // namespace camber
