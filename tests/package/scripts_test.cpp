// The two commands for a bare machine and the list of packages, with stand-ins for apt and dpkg;
// and the summary of the tests, with ctest on tests of its own.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::read_text;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

namespace {

/// A folder of stand-in programs that comes first on PATH; $LOG takes what they note.
class Scripts : public testing::Test {
 protected:
  void stand_in(const std::string& name, const std::string& body) {
    fs::create_directories(folder_.path() / "bin");
    const fs::path file = folder_.path() / "bin" / name;
    std::ofstream(file) << "#!/bin/sh\n" << body << "\n";
    fs::permissions(file, fs::perms::owner_all);
  }

  /// A machine where of all packages only cmake and g++ are installed.
  void stand_in_for_dpkg() {
    stand_in("dpkg-query", "echo 'ii  cmake'; echo 'hi  g++'; echo 'rc  ninja-build'; exit 1");
  }

  /// Runs a script of the checkout, or of a copy of it.
  int run(const std::string& command, const fs::path& root = camber::test::source_dir()) {
    return run_line("'" + root.string() + "'/" + command);
  }

  /// A line for the shell, in the folder, with the stand-ins.
  int run_line(const std::string& command) {
    const std::string line = "cd '" + folder_.path().string() + "' && LOG='" + log_path().string() +
                             "' PATH='" + folder_.path().string() + "/bin':\"$PATH\" " + command +
                             " >'" + (folder_.path() / "out").string() + "' 2>'" +
                             (folder_.path() / "err").string() + "' </dev/null";
    const int status = std::system(line.c_str());
    out_ = read_text(folder_.path() / "out");
    err_ = read_text(folder_.path() / "err");
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  /// samples/run.sh in a tree where a stand-in for cmake builds a stand-in for the program.
  void stand_in_for_builder(const std::string& cmake) {
    stand_in("cmake", cmake);
    const fs::path build = folder_.path() / "build/release";
    fs::create_directories(build / "bin");
    std::ofstream(build / "build.ninja") << "\n";
    std::ofstream(build / "bin/camber") << "#!/bin/sh\necho made \"$@\"\n";
    fs::permissions(build / "bin/camber", fs::perms::owner_all);
    fs::create_directories(folder_.path() / "samples");
    fs::copy_file(camber::test::source_dir() / "samples/run.sh", folder_.path() / "samples/run.sh");
  }

  fs::path log_path() const { return folder_.path() / "log"; }

  /// A checkout whose tests are those of a CTestTestfile.cmake, and whose builds do nothing.
  fs::path checkout_with_tests(const std::string& tests) {
    stand_in("cmake", "exit 0");
    const fs::path root = folder_.path() / "checkout";
    fs::create_directories(root / "tests");
    fs::create_directories(root / "build" / "release");
    fs::copy_file(camber::test::source_dir() / "tests" / "run.sh", root / "tests" / "run.sh");
    std::ofstream(root / "build" / "release" / "CTestTestfile.cmake") << tests;
    return root;
  }

  camber::test::TemporaryFolder folder_;
  std::string out_, err_;
};

TEST_F(Scripts, ExplainThemselvesAndRefuseUnknownOptions) {
  for (const char* script : {"samples/install_packages.sh", "samples/run.sh", "samples/figures.sh",
                             "samples/paper_kitti.sh", "tests/run.sh", ".ci/run"}) {
    SCOPED_TRACE(script);
    EXPECT_EQ(run(std::string(script) + " --help"), 0);
    EXPECT_THAT(out_, StartsWith("Usage: "));
    EXPECT_EQ(err_, "");
    EXPECT_EQ(run(std::string(script) + " --no-such-option"), 2);
    EXPECT_EQ(out_, "");
    EXPECT_THAT(err_, HasSubstr("unknown option --no-such-option"));
  }
}

TEST_F(Scripts, ListThePackages) {
  ASSERT_EQ(run("samples/install_packages.sh --list"), 0);
  EXPECT_THAT(out_, AllOf(HasSubstr("libpcl-dev\n"), HasSubstr("libceres-dev\n"),
                          Not(HasSubstr("libgtest-dev\n"))));
  ASSERT_EQ(run("samples/install_packages.sh --tests --list"), 0);
  EXPECT_THAT(out_, HasSubstr("libgtest-dev\n"));
}

TEST_F(Scripts, InstallOnlyWhatIsMissing) {
  stand_in_for_dpkg();
  stand_in("id", "echo 0");
  stand_in("apt-cache", "exit 0");
  stand_in("apt-get", "echo \"$@\" >>\"$LOG\"");
  ASSERT_EQ(run("samples/install_packages.sh"), 0) << err_;
  const std::string log = read_text(log_path());
  EXPECT_THAT(log, AllOf(HasSubstr("install --no-install-recommends"), HasSubstr(" ninja-build "),
                         HasSubstr(" libpcl-dev "), Not(HasSubstr(" cmake ")),
                         Not(HasSubstr(" g++ ")), Not(HasSubstr("update"))));
}

TEST_F(Scripts, UpdateTheListsWhereTheyAreAbsentOrOld) {
  stand_in_for_dpkg();
  stand_in("id", "echo 0");
  stand_in("apt-cache", "exit 100");
  stand_in("apt-get", "echo \"$@\" >>\"$LOG\"");
  ASSERT_EQ(run("samples/install_packages.sh"), 0) << err_;
  const std::string log = read_text(log_path());
  ASSERT_THAT(log, AllOf(HasSubstr(" update\n"), HasSubstr(" install ")));
  EXPECT_LT(log.find(" update\n"), log.find(" install "));
}

TEST_F(Scripts, SayWhyAptFailed) {
  stand_in_for_dpkg();
  stand_in("id", "echo 0");
  stand_in("apt-cache", "exit 0");
  stand_in("apt-get", "echo the mirror is away; exit 100");
  EXPECT_EQ(run("samples/install_packages.sh"), 1);
  EXPECT_THAT(err_, AllOf(HasSubstr("the mirror is away"), HasSubstr("could not install")));
}

TEST_F(Scripts, SayWhatToDoWithoutRootAndSudo) {
  stand_in_for_dpkg();
  stand_in("id", "echo 1000");
  stand_in("sudo", "exit 1");
  stand_in("apt-get", "echo \"$@\" >>\"$LOG\"");
  EXPECT_EQ(run("samples/install_packages.sh"), 1);
  EXPECT_THAT(err_, AllOf(HasSubstr("as root, run: apt-get install --no-install-recommends "),
                          HasSubstr("libpcl-dev"), Not(HasSubstr(" cmake "))));
  EXPECT_FALSE(fs::exists(log_path()));
}

TEST_F(Scripts, UseSudoWhereItAsksForNothing) {
  stand_in_for_dpkg();
  stand_in("id", "echo 1000");
  stand_in("sudo", "if [ \"$1\" != -n ]; then echo sudo >>\"$LOG\"; \"$@\"; fi");
  stand_in("apt-cache", "exit 0");
  stand_in("apt-get", "echo \"$@\" >>\"$LOG\"");
  ASSERT_EQ(run("samples/install_packages.sh"), 0) << err_;
  EXPECT_THAT(read_text(log_path()), AllOf(StartsWith("sudo\n"), HasSubstr(" install ")));
}

/// What the next test's ctest runs: skips for the reason in the environment.
TEST(Summary, SkipsWhereItIsToldTo) {
  const char* const reason = std::getenv("CAMBER_TEST_SKIP_REASON");
  if (reason) GTEST_SKIP() << reason;
  EXPECT_EQ(reason, nullptr);
}

/// A CTestTestfile's test: this program, skipping as gtest_discover_tests() lets ctest see it.
std::string skipping_test(const std::string& name, const std::string& reason) {
  return "add_test(" + name + " [==[" + fs::read_symlink("/proc/self/exe").string() +
         "]==] --gtest_filter=Summary.SkipsWhereItIsToldTo)\nset_tests_properties(" + name +
         " PROPERTIES SKIP_REGULAR_EXPRESSION [==[\\[  SKIPPED \\]]==] ENVIRONMENT "
         "[==[CAMBER_TEST_SKIP_REASON=" +
         reason + "]==])\n";
}

TEST_F(Scripts, SummaryOfTheTestsCountsTheSkippedByReason) {
  const fs::path root = checkout_with_tests(
      "add_test(passes true)\n" + skipping_test("a", "no Xvfb & no <display>") +
      skipping_test("b", "no data (set IT): /a/b") + skipping_test("c", "no data (set IT): /a/c") +
      "add_test(d sh -c \"exit 77\")\nset_tests_properties(d PROPERTIES SKIP_RETURN_CODE 77)\n");
  ::setenv("CAMBER_FUZZ_SECONDS", "0", 1);
  ASSERT_EQ(run("tests/run.sh --no-install", root), 0) << out_ << err_;
  EXPECT_THAT(out_, HasSubstr("100% tests passed"));
  EXPECT_THAT(out_, HasSubstr("\n4 skipped: 2 no data (set IT), 1 SKIP_RETURN_CODE=77, "
                              "1 no Xvfb & no <display>\n"));
}

TEST_F(Scripts, BenchmarksWriteTheirJson) {
  const fs::path root = checkout_with_tests("add_test(passes true)\n");
  fs::create_directories(root / "build" / "release" / "bin");
  for (const char* name : {"main_job", "reconstruct"}) {
    const fs::path program = root / "build" / "release" / "bin" / ("bench_" + std::string(name));
    std::ofstream(program) << "#!/bin/sh\necho " << name << " \"$@\" >>\"$LOG\"\n";
    fs::permissions(program, fs::perms::owner_all);
  }
  ::setenv("CAMBER_FUZZ_SECONDS", "0", 1);
  ASSERT_EQ(run("tests/run.sh --no-install --benchmarks", root), 0) << out_ << err_;
  EXPECT_EQ(read_text(log_path()),
            "main_job --json build/release/benchmarks/main_job.json\nreconstruct\n");
  EXPECT_TRUE(fs::is_directory(root / "build" / "release" / "benchmarks"));
  EXPECT_THAT(out_, HasSubstr("make_benchmark_md.py build/release/benchmarks --store "));
}

TEST_F(Scripts, SummaryOfTheTestsSaysThatNoneWasSkippedAndKeepsTheFailure) {
  ::setenv("CAMBER_FUZZ_SECONDS", "0", 1);
  ASSERT_EQ(run("tests/run.sh --no-install", checkout_with_tests("add_test(passes true)\n")), 0);
  EXPECT_THAT(out_, HasSubstr("\n0 skipped\n"));
  std::ofstream(folder_.path() / "checkout" / "build" / "release" / "CTestTestfile.cmake")
      << "add_test(fails false)\n";
  EXPECT_EQ(run("tests/run.sh --no-install", folder_.path() / "checkout"), 1);
  EXPECT_THAT(out_, AllOf(HasSubstr("(Failed)"), HasSubstr("\n0 skipped\n")));
}

TEST_F(Scripts, TestsThatTookLongLeaveTheFuzzersOut) {
  const fs::path root = checkout_with_tests("add_test(passes true)\n");
  fs::create_directories(root / "build" / "fuzz" / "bin");
  const fs::path fuzzer = root / "build" / "fuzz" / "bin" / "fuzz_a";
  std::ofstream(fuzzer) << "#!/bin/sh\necho stat::number_of_executed_units: 7\n";
  fs::permissions(fuzzer, fs::perms::owner_all);
  stand_in("clang++", "exit 0");
  ::setenv("CAMBER_FUZZ_SECONDS", "1", 1);
  ::setenv("CAMBER_FUZZ_LATEST", "40", 1);
  ASSERT_EQ(run("tests/run.sh --no-install", root), 0) << out_ << err_;
  EXPECT_THAT(out_, HasSubstr("fuzz_a: 7 executions, nothing found\n"));
  ::setenv("CAMBER_FUZZ_LATEST", "0", 1);
  const int code = run("tests/run.sh --no-install", root);
  ::unsetenv("CAMBER_FUZZ_LATEST");
  ASSERT_EQ(code, 0) << out_ << err_;
  EXPECT_THAT(out_, AllOf(HasSubstr("the fuzzers are left out"), Not(HasSubstr("fuzz_a"))));
}

const char* const kForty = "for i in $(seq 40); do echo \"[$i/40] Building part $i\"; done";

TEST_F(Scripts, TellHowFarTheBuildIsInAFewLines) {
  stand_in_for_builder(kForty);
  ASSERT_EQ(run_line("samples/run.sh --no-install"), 0) << err_;
  EXPECT_THAT(out_, StartsWith("[10/40]\n[20/40]\n[30/40]\n[40/40]\nmade reconstruct "));
  EXPECT_EQ(err_, "");
}

TEST_F(Scripts, TellHowFarTheBuildIsInOneLineOfATerminal) {
  stand_in_for_builder(kForty);
  ASSERT_EQ(run_line("script -qec 'samples/run.sh --no-install' /dev/null"), 0) << err_;
  std::string counts;
  for (int i = 1; i <= 40; ++i) counts += "\r[" + std::to_string(i) + "/40]";
  EXPECT_THAT(out_, StartsWith(counts + "\r\033[Kmade reconstruct "));
}

TEST_F(Scripts, ShowTheOutputOfABuildThatFails) {
  stand_in_for_builder("echo '[1/2] Building part 1'; echo 'part 1: error'; exit 1");
  EXPECT_EQ(run_line("samples/run.sh --no-install"), 1);
  EXPECT_THAT(err_, AllOf(HasSubstr("part 1: error"), HasSubstr("the build failed")));
  EXPECT_THAT(out_, Not(HasSubstr("made")));
}

}  // namespace
