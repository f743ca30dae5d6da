#include "camber/cloud/detail/bin_layout.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "camber/core/errors.h"

namespace camber::detail {
namespace {

constexpr std::size_t kFewest = 3, kMost = 8;  // floats a point that are tried
constexpr std::size_t kNamed = 6;              // beyond it no program's columns are known
constexpr std::size_t kKitti = 4;
constexpr std::size_t kPeriod = 840;  // floats; a multiple of each number that is tried
constexpr std::size_t kBlocks = 16, kPeriodsInBlock = 2;
constexpr std::uint64_t kFewFloats = 64;    // too few for columns to differ by their spread
constexpr double kLargestCoordinate = 1e6;  // m
constexpr double kLeastSpread = 1e-3;       // of a column; the precision of a laser scanner, m

using Floats = std::vector<float>;

/// Blocks that lie evenly in the file and begin where points of any of the numbers begin.
std::vector<Floats> read_blocks(const FileBytes& file) {
  const std::uint64_t floats = file.size() / sizeof(float);
  const std::uint64_t length = kPeriod * kPeriodsInBlock;
  std::vector<std::uint64_t> starts = {0};
  if (floats > length * kBlocks) {
    for (std::uint64_t b = 1; b < kBlocks; ++b) {
      starts.push_back((floats - length) / kPeriod * b / (kBlocks - 1) * kPeriod);
    }
  }
  std::vector<Floats> blocks;
  for (const std::uint64_t start : starts) {
    const std::uint64_t count =
        starts.size() > 1 ? length : std::min<std::uint64_t>(floats, length * kBlocks);
    const std::string bytes = file.read(start * sizeof(float), count * sizeof(float));
    Floats block(static_cast<std::size_t>(count));
    std::memcpy(block.data(), bytes.data(), bytes.size());
    blocks.push_back(std::move(block));
  }
  return blocks;
}

struct Candidate {
  std::size_t floats = 0;
  double spread = std::numeric_limits<double>::infinity();  // mean logarithm, of all columns
  bool sound = true;  // coordinates finite and below 1000 km, the fourth column not negative
  bool whole = true;  // the size is a multiple
  bool rings = true;  // the fifth column is whole numbers from 0 to 255
};

Candidate judge(const std::vector<Floats>& blocks, std::size_t n, std::uint64_t size) {
  Candidate out;
  out.floats = n;
  out.whole = size % (n * sizeof(float)) == 0;
  double sum = 0.0;
  for (std::size_t c = 0; c < n; ++c) {
    double count = 0.0, mean = 0.0, squares = 0.0;
    for (const Floats& block : blocks) {
      for (std::size_t i = c; i < block.size() / n * n; i += n) {
        const double value = block[i];
        if (!std::isfinite(value)) continue;  // a direction without a return
        if (c < 3 && std::abs(value) >= kLargestCoordinate) out.sound = false;
        if (c == 3 && value < 0.0) out.sound = false;
        if (c == 4 && !(value >= 0.0 && value < 256.0 && value == std::floor(value))) {
          out.rings = false;
        }
        count += 1.0;
        const double difference = value - mean;
        mean += difference / count;
        squares += difference * (value - mean);
      }
    }
    sum += std::log(std::max(count > 0.0 ? std::sqrt(squares / count) : 0.0, kLeastSpread));
  }
  out.spread = sum / static_cast<double>(n);
  return out;
}

std::vector<std::string> columns_of(std::size_t floats, bool rings) {
  std::vector<std::string> columns = {"x", "y", "z"};
  if (floats > 3) columns.emplace_back("intensity");
  for (std::size_t c = 4; c < floats; ++c) {
    columns.push_back(c == 4 && rings ? "ring" : "column_" + std::to_string(c + 1));
  }
  return columns;
}

std::string joined(const std::vector<std::string>& columns) {
  std::string out;
  for (const std::string& name : columns) out += (out.empty() ? "" : ",") + name;
  return out;
}

BinLayout kitti() { return {columns_of(kKitti, false), true}; }

[[noreturn]] void fail_cut(const FileBytes& file, std::size_t floats) {
  const std::string bytes = std::to_string(floats * sizeof(float));
  throw InputError(
      file.name(),
      "found " + std::to_string(file.size()) + " bytes, expected a multiple of " + bytes +
          (floats == kKitti ? " (float32 x y z reflectance)"
                            : ", since its points seem to have " + std::to_string(floats) +
                                  " floats (--columns names them)"));
}

}  // namespace

BinLayout find_bin_layout(const FileBytes& file, bool lenient) {
  const std::uint64_t size = file.size();
  if (size / sizeof(float) < kFewFloats) {
    if (size % (kKitti * sizeof(float)) != 0 && !lenient) fail_cut(file, kKitti);
    return kitti();
  }
  const std::vector<Floats> blocks = read_blocks(file);
  std::size_t sampled = 0;
  for (const Floats& block : blocks) sampled += block.size();
  std::vector<Candidate> all;
  for (std::size_t n = kFewest; n <= kMost; ++n) all.push_back(judge(blocks, n, size));
  const double least = std::min_element(all.begin(), all.end(), [](const auto& a, const auto& b) {
                         return a.spread < b.spread;
                       })->spread;
  // A logarithm of a standard deviation of n values is off by 1 / sqrt(2 n), 1 sigma.
  const double margin =
      0.1 + 3.0 / std::sqrt(2.0 * static_cast<double>(sampled) / static_cast<double>(kMost));
  std::vector<Candidate> good;
  std::copy_if(all.begin(), all.end(), std::back_inserter(good),
               [&](const Candidate& c) { return c.spread <= least + margin; });
  const auto keep = [&](auto&& fits) {
    std::vector<Candidate> kept;
    std::copy_if(good.begin(), good.end(), std::back_inserter(kept), fits);
    if (!kept.empty()) good = std::move(kept);
  };
  const bool may_be_kitti = std::any_of(
      good.begin(), good.end(), [](const Candidate& c) { return c.floats == kKitti && c.whole; });
  if (may_be_kitti) {
    // Beside the form that the name promises stands only one whose own columns show.
    keep([](const Candidate& c) {
      return c.floats == kKitti ||
             (c.sound && c.whole && ((c.floats == 5 && c.rings) || c.floats == 6));
    });
  } else {
    // Two points in one are as narrow as one.
    const std::vector<Candidate> narrow = good;
    keep([&](const Candidate& c) {
      return std::none_of(narrow.begin(), narrow.end(), [&](const Candidate& shorter) {
        return shorter.floats < c.floats && c.floats % shorter.floats == 0;
      });
    });
  }
  keep([](const Candidate& c) { return c.sound; });
  keep([](const Candidate& c) { return c.whole; });
  if (good.size() > 1) {
    std::string forms;
    for (const Candidate& c : good) {
      forms += (forms.empty() ? "" : " or ") + std::to_string(c.floats) + " floats a point (" +
               joined(columns_of(c.floats, c.rings)) + ")";
    }
    throw InputError(file.name(), "found what may be " + forms +
                                      ", expected one form: name its columns with --columns");
  }
  const Candidate& best = good.front();
  if (!best.whole && !lenient) fail_cut(file, best.floats);
  if (best.floats > kNamed) {
    throw InputError(file.name(), "found what seem to be " + std::to_string(best.floats) +
                                      " floats a point, expected 3 to 6 (x y z, intensity, ring); "
                                      "name the columns with --columns");
  }
  if (best.floats == kKitti) return kitti();
  return {columns_of(best.floats, best.rings), false};
}

}  // namespace camber::detail
