#include "camber/tiles/detail/tile_spills.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"

namespace fs = std::filesystem;

namespace camber::detail {
namespace {

bool parse_name(const std::string& name, std::pair<std::int64_t, std::int64_t>* tile) {
  long long column = 0, row = 0;
  char rest = 0;
  if (std::sscanf(name.c_str(), "%lld_%lld%c", &column, &row, &rest) != 2) return false;
  *tile = {column, row};
  return TileSpills::name_of(column, row) == name;
}

}  // namespace

TileSpills::TileSpills(fs::path folder, std::size_t record_length, std::size_t memory)
    : folder_(std::move(folder)), record_length_(record_length), memory_(memory) {}

std::string TileSpills::name_of(std::int64_t column, std::int64_t row) {
  return std::to_string(column) + "_" + std::to_string(row);
}

fs::path TileSpills::path_of(const std::string& name) const { return folder_ / (name + ".points"); }

void TileSpills::clear() {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) fs::remove(entry.path(), error);
  spills_.clear();
  last_ = nullptr;
  held_ = 0;
}

bool TileSpills::resume(const std::map<std::string, std::uint64_t>& sizes) {
  std::error_code error;
  std::vector<fs::path> others;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    if (sizes.count(entry.path().stem().string()) == 0) others.push_back(entry.path());
  }
  for (const fs::path& other : others) fs::remove(other, error);
  for (const auto& [name, size] : sizes) {
    std::pair<std::int64_t, std::int64_t> tile;
    const std::uintmax_t there = fs::file_size(path_of(name), error);
    bool good = !error && there >= size && size % record_length_ == 0 && parse_name(name, &tile);
    if (good && there > size) {
      fs::resize_file(path_of(name), size, error);
      good = !error;
    }
    if (!good) {
      clear();
      return false;
    }
    spills_[tile].written = size;
  }
  return true;
}

bool TileSpills::add(std::int64_t column, std::int64_t row, const char* record) {
  if (!last_ || last_tile_ != std::make_pair(column, row)) {
    last_tile_ = {column, row};
    last_ = &spills_[last_tile_];
  }
  last_->held.append(record, record_length_);
  held_ += record_length_;
  return held_ >= memory_;
}

void TileSpills::flush() {
  for (auto& [tile, spill] : spills_) {
    if (spill.held.empty()) continue;
    throw_if_interrupted();
    const fs::path path = path_of(name_of(tile.first, tile.second));
    errno = 0;
    std::ofstream out(path, std::ios::binary | std::ios::app);
    out.write(spill.held.data(), static_cast<std::streamsize>(spill.held.size()));
    out.close();
    if (!out) throw OutputError(path.string(), std::strerror(errno != 0 ? errno : EIO));
    spill.written += spill.held.size();
    std::string().swap(spill.held);  // gives its memory back
  }
  held_ = 0;
}

std::map<std::string, std::uint64_t> TileSpills::sizes() const {
  std::map<std::string, std::uint64_t> out;
  for (const auto& [tile, spill] : spills_) out[name_of(tile.first, tile.second)] = spill.written;
  return out;
}

std::vector<std::pair<std::int64_t, std::int64_t>> TileSpills::tiles() const {
  std::vector<std::pair<std::int64_t, std::int64_t>> out;
  for (const auto& [tile, spill] : spills_) out.push_back(tile);
  std::sort(out.begin(), out.end(), [](const auto& a, const auto& b) {
    return std::make_pair(a.second, a.first) < std::make_pair(b.second, b.first);
  });
  return out;
}

std::string TileSpills::read(std::int64_t column, std::int64_t row) const {
  const auto found = spills_.find({column, row});
  const std::uint64_t size = found == spills_.end() ? 0 : found->second.written;
  const fs::path path = path_of(name_of(column, row));
  std::ifstream in(path, std::ios::binary);
  std::string out;
  out.resize(static_cast<std::size_t>(size));
  if (!in.read(out.data(), static_cast<std::streamsize>(size))) {
    throw InputError(path.string(), "found fewer bytes than the " + std::to_string(size) +
                                        " that were written; repeat the plan with --overwrite");
  }
  return out;
}

void TileSpills::remove(std::int64_t column, std::int64_t row) const {
  std::error_code ignored;
  fs::remove(path_of(name_of(column, row)), ignored);
}

}  // namespace camber::detail
