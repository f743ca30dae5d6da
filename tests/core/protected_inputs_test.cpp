#include "camber/core/protected_inputs.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <functional>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

bool refused(const std::function<void()>& write) {
  try {
    write();
  } catch (const UsageError&) {
    return true;
  }
  return false;
}

class ProtectedInputs : public ::testing::Test {
 protected:
  fs::path path(const std::string& name) const { return folder_.path() / name; }
  void make(const std::string& name) const { std::ofstream(path(name)) << "input"; }

  /// Inputs are protected until the process ends: in one of its own. @return whether it is refused
  /// to write there.
  bool refuses(const fs::path& input, const std::function<void()>& write) const {
    bool result = false;
    EXPECT_EXIT(
        {
          protect_inputs({input, path("none"), ""});
          std::_Exit(refused(write) ? 7 : 8);
        },
        [&result](int status) {
          result = WEXITSTATUS(status) == 7;
          return WEXITSTATUS(status) == 7 || WEXITSTATUS(status) == 8;
        },
        "");
    return result;
  }
  bool refuses_file(const std::string& input, const std::string& output) const {
    return refuses(path(input), [&] { write_file_atomically(path(output), "output"); });
  }
  bool refuses_folder(const std::string& input, const std::string& output) const {
    return refuses(path(input), [&] { AtomicFolder(path(output), true).commit(); });
  }

  test::TemporaryFolder folder_;
};

TEST_F(ProtectedInputs, AreNotReplacedUnderAnyName) {
  make("input");
  fs::create_hard_link(path("input"), path("hard"));
  fs::create_symlink("input", path("soft"));
  EXPECT_TRUE(refuses_file("input", "input"));
  EXPECT_TRUE(refuses_file("input", "./input"));
  EXPECT_TRUE(refuses_file("input", "hard"));
  EXPECT_TRUE(refuses_file("input", "soft"));
  EXPECT_TRUE(refuses_file("soft", "input"));
  EXPECT_EQ(test::read_text(path("input")), "input");
  EXPECT_FALSE(refuses_file("input", "other"));
  EXPECT_TRUE(refuses(path("input"), [&] { check_output_file(path("soft")); }));
  EXPECT_FALSE(refuses_file("none", "none"));
}

TEST_F(ProtectedInputs, KeepTheFolderThatHoldsThem) {
  fs::create_directories(path("result/below"));
  fs::create_directory(path("beside"));
  make("result/below/input");
  make("input");
  fs::create_symlink(path("input"), path("result/link"));
  fs::create_symlink(path("result/below/input"), path("to_below"));
  EXPECT_TRUE(refuses_folder("result/below/input", "result"));
  EXPECT_TRUE(refuses_folder("result/below", "result"));
  EXPECT_TRUE(refuses_folder("result", "result"));
  EXPECT_TRUE(refuses_folder("result/link", "result")) << "the link would be lost";
  EXPECT_TRUE(refuses_folder("to_below", "result"));
  EXPECT_TRUE(fs::exists(path("result/below/input")));
  EXPECT_FALSE(refuses_folder("input", "beside"));
  EXPECT_FALSE(refuses_folder("result/..", "beside"));
  EXPECT_TRUE(refuses(path("result/link"), [&] { check_output_folder(path("result"), true); }));
}

}  // namespace
}  // namespace camber
