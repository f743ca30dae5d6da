// The mutators of the fuzzers: the same seed gives the same input, and what a reader checks first
// (lengths, counts, check sums, the form of a document) holds in most of what they make.

#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr int kMutations = 400;  // of each seed
constexpr std::size_t kLongest = 1 << 16;

std::map<std::string, std::string> seeds(const std::string& folder) {
  std::map<std::string, std::string> out;
  for (const auto& entry : fs::directory_iterator(fs::path(CAMBER_FUZZ_CORPUS) / folder)) {
    std::ifstream file(entry.path(), std::ios::binary);
    out[entry.path().filename()] = {std::istreambuf_iterator<char>(file),
                                    std::istreambuf_iterator<char>()};
  }
  EXPECT_FALSE(out.empty());
  return out;
}

/// One mutation by the mutator itself.
std::string once(const std::string& seed, std::uint64_t number, Mutator mutator) {
  Dice dice(number), of_bytes(number + 1);
  return mutator(seed, dice, [&](std::string_view input, std::size_t most) {
    return some_bytes(input, most, of_bytes);
  });
}

/// What share of the mutations of a seed is `sound`, of those that differ from it.
double share(const std::string& seed, Mutator mutator,
             const std::function<bool(const std::string&)>& sound) {
  std::set<std::string> made;
  for (int i = 0; i < kMutations; ++i)
    made.insert(once(seed, static_cast<std::uint64_t>(i), mutator));
  made.erase(seed);
  EXPECT_GE(made.size(), kMutations / 4u);  // they differ from the seed and from one another
  return static_cast<double>(std::count_if(made.begin(), made.end(), sound)) /
         static_cast<double>(std::max<std::size_t>(made.size(), 1));
}

TEST(Mutators, AreTheSameForTheSameSeedAndNotLongerThanAllowed) {
  const std::pair<Mutator, const char*> all[] = {{mutate_json, "scene"},
                                                 {mutate_text, "pcd"},
                                                 {mutate_document, "own_detections"},
                                                 {mutate_las, "las"},
                                                 {mutate_laz, "laz"},
                                                 {mutate_copc, "copc"},
                                                 {mutate_e57, "e57"},
                                                 {mutate_image, "image"},
                                                 {mutate_bag, "rosbag"},
                                                 {mutate_numbers, "colmap"},
                                                 {mutate_text_or_numbers, "colmap"}};
  for (const auto& [mutator, folder] : all) {
    for (const auto& [name, seed] : seeds(folder)) {
      for (std::uint64_t i = 0; i < 50; ++i) {
        const auto make = [&seed = seed, i, mutator = mutator](std::size_t most) {
          Dice dice(i);
          const ByteMutation bytes = [&](std::string_view input, std::size_t longest) {
            return some_bytes(input, longest, dice);
          };
          return mutate(seed, most, i, mutator, bytes);
        };
        EXPECT_EQ(make(kLongest), make(kLongest)) << folder << "/" << name;
        EXPECT_LE(make(100).size(), 100u) << folder << "/" << name;
      }
    }
  }
}

TEST(Mutators, TakeAnyBytes) {
  const Mutator all[] = {
      mutate_json,           mutate_text, mutate_document, mutate_las, mutate_laz,
      mutate_copc,           mutate_e57,  mutate_image,    mutate_bag, mutate_numbers,
      mutate_text_or_numbers};
  std::vector<std::string> inputs{"",
                                  "\n",
                                  "{",
                                  "[]",
                                  "0",
                                  "LASF",
                                  "#ROSBAG V2.0\n",
                                  "\x89PNG\r\n\x1a\n",
                                  "\xFF\xD8\xFF\xE0",
                                  "ply\nend_header",
                                  "\nDATA ",
                                  std::string(300, '\xFF')};
  for (const char length : {0, 1, 2, 3}) {  // of a JPEG's segment, which counts its own two bytes
    inputs.push_back(std::string("\xFF\xD8\xFF\xE0") + '\0' + length + "JFIF");
  }
  for (const char* const folder : {"las", "laz", "copc", "e57", "image", "rosbag"}) {
    for (const auto& [name, seed] : seeds(folder)) {
      for (const std::size_t n : {9, 40, 120, 227, 300}) inputs.push_back(seed.substr(0, n));
    }
  }
  for (const std::string& input : inputs) {
    for (const Mutator mutator : all) {
      for (std::uint64_t i = 0; i < 60; ++i) {
        EXPECT_LE(once(input, i, mutator).size(), 4 * input.size() + 3000);  // a record of LAS
      }
    }
  }
}

TEST(Mutators, KeepJsonADocument) {
  for (const char* const folder :
       {"scene", "surface", "vehicles", "run", "prior", "network_file"}) {
    for (const auto& [name, seed] : seeds(folder)) {
      // The rest got a number that JSON does not have, on purpose.
      EXPECT_GT(share(seed, mutate_json,
                      [](const std::string& text) { return nlohmann::json::accept(text); }),
                0.85)
          << folder << "/" << name;
    }
  }
}

/// Chunks to the end of the file, each with its check sum.
bool whole_png(const std::string& png) {
  std::size_t at = 8;
  while (at < png.size()) {
    if (at + 12 > png.size()) return false;
    const auto number = [&](std::size_t place) {
      std::uint32_t value = 0;
      for (std::size_t i = 0; i < 4; ++i)
        value = value << 8 | static_cast<std::uint8_t>(png[place + i]);
      return value;
    };
    const std::size_t size = number(at);
    if (size > png.size() - at - 12) return false;
    const auto sum = ::crc32(0, reinterpret_cast<const Bytef*>(png.data() + at + 4),
                             static_cast<uInt>(size + 4));
    if (number(at + 8 + size) != sum) return false;
    at += 12 + size;
  }
  return true;
}

TEST(Mutators, KeepCheckSumsOfPngRight) {
  for (const auto& [name, seed] : seeds("image")) {
    if (name.find(".png") == std::string::npos) continue;
    EXPECT_EQ(share(seed, mutate_image, whole_png), 1.0) << name;
  }
}

/// Variable length records that end where the points begin or before, and points for all counted.
bool whole_las(const std::string& las) {
  if (las.size() < 227) return false;
  std::uint64_t at = get_number(las, 94, 2);
  const std::uint64_t points = get_number(las, 96, 4);
  for (std::uint64_t left = get_number(las, 100, 4); left > 0; --left) {
    if (at + 54 > las.size()) return false;
    at += 54 + get_number(las, at + 20, 2);
  }
  return at <= points && points + get_number(las, 105, 2) * get_number(las, 107, 4) <= las.size();
}

TEST(Mutators, KeepPlacesAndCountsOfLasTogether) {
  for (const auto& [name, seed] : seeds("las")) {
    EXPECT_GT(share(seed, mutate_las, whole_las), 0.8) << name;
  }
}

/// Pages with right checksums, and XML within them.
bool whole_e57(const std::string& file) {
  if (file.size() < 48 || file.compare(0, 8, "ASTM-E57") != 0) return false;
  const std::size_t page = get_number(file, 40, 8);
  if (page != 256 || file.size() % page != 0 || get_number(file, 16, 8) != file.size())
    return false;
  for (std::size_t at = 0; at < file.size(); at += page) {
    std::uint32_t crc = 0xffffffffu, stored = 0;
    for (std::size_t i = at; i < at + page - 4; ++i) {
      crc ^= static_cast<unsigned char>(file[i]);
      for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (0x82F63B78u & (0u - (crc & 1)));
    }
    for (std::size_t i = page - 4; i < page; ++i) {
      stored = stored << 8 | static_cast<unsigned char>(file[at + i]);
    }
    if (~crc != stored) return false;
  }
  return get_number(file, 24, 8) < file.size();
}

TEST(Mutators, KeepPagesOfE57Whole) {
  for (const auto& [name, seed] : seeds("e57")) {
    EXPECT_GT(share(seed, mutate_e57, whole_e57), 0.8) << name;
  }
}

/// COPC's record and the entries of a root page that lies within the file.
bool whole_copc(const std::string& file) {
  if (file.size() < 589 || file.compare(377, 4, "copc") != 0) return false;
  const std::uint64_t root = get_number(file, 429 + 40, 8), size = get_number(file, 429 + 48, 8);
  return root <= file.size() && size <= file.size() - root && size % 32 == 0;
}

TEST(Mutators, KeepTheRootPageOfCopc) {
  for (const auto& [name, seed] : seeds("copc")) {
    EXPECT_GT(share(seed, mutate_copc, whole_copc), 0.6) << name;  // or its place is changed
  }
}

/// Records to the end of the file.
bool whole_bag(const std::string& bag) {
  std::size_t at = 13;
  while (at < bag.size()) {
    for (int part = 0; part < 2; ++part) {
      if (at + 4 > bag.size()) return false;
      const std::uint64_t size = get_number(bag, at, 4);
      if (size > bag.size() - at - 4) return false;
      at += 4 + size;
    }
  }
  return true;
}

TEST(Mutators, KeepLengthsOfABagRight) {
  for (const auto& [name, seed] : seeds("rosbag")) {
    EXPECT_EQ(share(seed, mutate_bag, whole_bag), 1.0) << name;
  }
}

TEST(Mutators, KeepTheHeaderOfACloud) {
  for (const auto& [name, seed] : seeds("pcd")) {
    EXPECT_GT(
        share(seed, mutate_text,
              [](const std::string& text) { return text.find("DATA ") != std::string::npos; }),
        0.8)
        << name;
  }
}

TEST(OddNumbers, FitTheirFields) {
  Dice dice(1);
  for (int i = 0; i < 2000; ++i) {
    EXPECT_LE(odd_integer(200, 1, dice), 0xFFu);
    EXPECT_LE(odd_integer(7, 2, dice), 0xFFFFu);
    EXPECT_LE(odd_integer(7, 4, dice), 0xFFFFFFFFu);
  }
}

}  // namespace
}  // namespace camber::fuzz
