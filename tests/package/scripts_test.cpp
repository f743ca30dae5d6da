// The two commands for a bare machine and the list of packages, with stand-ins for apt and dpkg.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include "support/test_data.h"

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

namespace {

std::string read_text(const fs::path& path) {
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

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

  int run(const std::string& command) {
    const std::string line = "cd '" + folder_.path().string() + "' && LOG='" + log_path().string() +
                             "' PATH='" + folder_.path().string() + "/bin':\"$PATH\" '" +
                             camber::test::source_dir().string() + "'/" + command + " >'" +
                             (folder_.path() / "out").string() + "' 2>'" +
                             (folder_.path() / "err").string() + "' </dev/null";
    const int status = std::system(line.c_str());
    out_ = read_text(folder_.path() / "out");
    err_ = read_text(folder_.path() / "err");
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  fs::path log_path() const { return folder_.path() / "log"; }

  camber::test::TemporaryFolder folder_;
  std::string out_, err_;
};

TEST_F(Scripts, ExplainThemselvesAndRefuseUnknownOptions) {
  for (const char* script : {"samples/install_packages.sh", "samples/run.sh", "samples/figures.sh",
                             "tests/run.sh", ".ci/run"}) {
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

}  // namespace
