#include "camber/core/hash.h"

#include <gtest/gtest.h>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "support/test_data.h"

namespace camber {
namespace {

TEST(HashFile, IsXxh3OfTheBytes) {
  const test::TemporaryFolder folder;
  const auto hash = [&](const std::string& bytes) {
    write_file_atomically(folder.path() / "file", bytes);
    return hash_file(folder.path() / "file");
  };
  // XXH3's 128-bit hash of nothing, as its specification gives it.
  EXPECT_EQ(hash(""), "99aa06d3014798d86001c324468d497f");
  const std::string large(300001, 'x');  // several reads
  std::string other = large;
  other[200000] = 'y';
  EXPECT_EQ(hash(large), hash(large));
  EXPECT_NE(hash(large), hash(other));
  EXPECT_NE(hash(large), hash(large + "x"));
  EXPECT_EQ(hash(large).size(), 32u);
  try {
    hash_file(folder.path() / "none");
    FAIL() << "a file that is not there has a hash";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("none: no such file"), std::string::npos)
        << error.what();
  }
  EXPECT_THROW(hash_file(folder.path()), InputError);
}

}  // namespace
}  // namespace camber
