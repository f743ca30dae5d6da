#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <unordered_map>
#include <vector>

/// The points of a cloud on their way to tiles: a growing file of records a tile.
namespace camber::detail {

class TileSpills {
 public:
  /// @param folder  exists
  /// @param memory  bytes of records that are held before they are written
  TileSpills(std::filesystem::path folder, std::size_t record_length, std::size_t memory);

  /// Goes on with files of the sizes that an earlier flush() left; what is longer is cut.
  /// @return false, and nothing is there, where one is shorter or missing
  bool resume(const std::map<std::string, std::uint64_t>& sizes);
  /// Removes all files of the folder.
  void clear();

  /// @return true once so much is held that flush() is due
  bool add(std::int64_t column, std::int64_t row, const char* record);
  /// Writes what is held. @throws OutputError
  void flush();

  /// Bytes of each tile's file after flush(), by the tile's name, "COLUMN_ROW".
  std::map<std::string, std::uint64_t> sizes() const;
  /// Columns and rows, in the order of rows, then columns.
  std::vector<std::pair<std::int64_t, std::int64_t>> tiles() const;
  /// The records of a tile. @throws InputError where the file is not as flush() left it
  std::string read(std::int64_t column, std::int64_t row) const;
  void remove(std::int64_t column, std::int64_t row) const;

  static std::string name_of(std::int64_t column, std::int64_t row);

 private:
  struct Spill {
    std::string held;
    std::uint64_t written = 0;
  };
  struct Hash {
    std::size_t operator()(const std::pair<std::int64_t, std::int64_t>& tile) const {
      return static_cast<std::size_t>(static_cast<std::uint64_t>(tile.first) *
                                          0x9E3779B97F4A7C15ull ^
                                      static_cast<std::uint64_t>(tile.second));
    }
  };
  std::filesystem::path path_of(const std::string& name) const;

  std::filesystem::path folder_;
  std::size_t record_length_, memory_, held_ = 0;
  std::unordered_map<std::pair<std::int64_t, std::int64_t>, Spill, Hash> spills_;
  std::pair<std::int64_t, std::int64_t> last_tile_{0, 0};
  Spill* last_ = nullptr;
};

}  // namespace camber::detail
