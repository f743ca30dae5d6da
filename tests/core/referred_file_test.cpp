#include "camber/core/referred_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camber/core/atomic_file.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class ReferredFile : public ::testing::Test {
 protected:
  ReferredFile() : path_(folder_.path() / "named.txt") { write_file_atomically(path_, "MARKER\n"); }

  /// The message of an error with this position and reason.
  std::string refusal(const std::string& position, const std::string& reason) const {
    try {
      read_referred_file(path_, "a point cloud", {}, [&](const LogSink&) -> int {
        if (position.empty()) throw InputError(path_.string(), reason);
        throw InputError(path_.string(), position, reason);
      });
    } catch (const InputError& error) {
      return error.what();
    }
    return "read";
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_;
};

TEST_F(ReferredFile, ErrorsNameThePlaceAndWhatWasExpectedAlone) {
  for (const char* place : {"line 1", "byte 12", "line 3, column 7 (byte 40)"}) {
    const std::string message = refusal(place, "found 'MARKER', expected MARKER: MARKER");
    EXPECT_THAT(message, HasSubstr(path_.string() + ": " + place + ": expected a point cloud"));
    EXPECT_THAT(message, Not(HasSubstr("MARKER")));
  }
  for (const char* place : {"", "MARKER", "line MARKER", "line 1 MARKER", "frames[0].MARKER"}) {
    const std::string message = refusal(place, "found 'MARKER': MARKER, expected x: line 4: 5");
    EXPECT_THAT(message, HasSubstr(path_.string() + ": expected a point cloud"));
    EXPECT_THAT(message, Not(HasSubstr("MARKER")));
  }
}

TEST_F(ReferredFile, WarningsAreCounted) {
  std::vector<std::string> warnings;
  const LogSink warn = [&](const std::string& sentence) { warnings.push_back(sentence); };
  const auto read = [](const LogSink& sink) {
    if (sink) sink("MARKER");
    if (sink) sink("MARKER");
    return 7;
  };
  EXPECT_EQ(read_referred_file(path_, "a number", warn, read), 7);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("named.txt: 2 remarks"));
  EXPECT_THAT(warnings[0], Not(HasSubstr("MARKER")));
  EXPECT_EQ(read_referred_file(path_, "a number", {}, read), 7);
}

TEST_F(ReferredFile, OneThatIsNotThereIsNamedAsSuch) {
  path_ = folder_.path() / "none.txt";
  EXPECT_EQ(refusal("line 1", "x"), path_.string() + ": no such file");
}

TEST_F(ReferredFile, FilesLieBelowAFolderOnceLinksAreFollowed) {
  const test::TemporaryFolder elsewhere;
  std::filesystem::create_symlink(elsewhere.path(), folder_.path() / "link");
  EXPECT_TRUE(lies_below(path_, folder_.path()));
  EXPECT_TRUE(lies_below(folder_.path() / "not" / "there", folder_.path()));
  EXPECT_FALSE(lies_below(folder_.path() / "link" / "file", folder_.path()));
  EXPECT_FALSE(lies_below(folder_.path() / ".." / "file", folder_.path()));
}

}  // namespace
}  // namespace camber
