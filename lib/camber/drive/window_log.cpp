#include "camber/drive/window_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/hash.h"

namespace camber {
namespace {

constexpr std::string_view kMagic = "camber drive windows 1\n";
constexpr std::size_t kHash = 32;  // hexadecimal digits

struct Record {
  char kind = 0;
  std::vector<std::uint8_t> bytes;
};

/// Bytes from where a file is read to its end.
std::uint64_t bytes_left(std::istream& in) {
  const auto here = in.tellg();
  in.seekg(0, std::ios::end);
  const auto end = in.tellg();
  in.seekg(here);
  return end > here ? static_cast<std::uint64_t>(end - here) : 0;
}

/// The next record; nothing at the end or where it is not whole.
std::optional<Record> next_record(std::istream& in) {
  Record out;
  std::uint64_t size = 0;
  std::array<char, kHash> hash{};
  if (!in.get(out.kind) || !in.read(reinterpret_cast<char*>(&size), sizeof size) ||
      size > bytes_left(in)) {
    return std::nullopt;
  }
  out.bytes.resize(size);
  if (!in.read(reinterpret_cast<char*>(out.bytes.data()), static_cast<std::streamsize>(size)) ||
      !in.read(hash.data(), hash.size())) {
    return std::nullopt;
  }
  const std::string_view held(reinterpret_cast<const char*>(out.bytes.data()), out.bytes.size());
  if (hash_bytes(held) != std::string_view(hash.data(), hash.size())) return std::nullopt;
  return out;
}

FrameRecord frame_of(const std::vector<std::uint8_t>& bytes) {
  const auto json = nlohmann::json::from_cbor(bytes);
  return {json.at(0), static_cast<FrameRecord::Kind>(json.at(1).get<int>()), json.at(2),
          json.at(3)};
}

}  // namespace

void require_equal_header(const std::filesystem::path& folder, const nlohmann::json& there,
                          const nlohmann::json& wanted) {
  for (const auto& [key, value] : wanted.items()) {
    if (there.contains(key) && there.at(key) == value) continue;
    throw UsageError(fmt::format(
        "--resume: {} was begun with another {} ({}, now {}): run without --resume to start anew",
        folder.string(), key, there.contains(key) ? there.at(key).dump() : "none", value.dump()));
  }
}

WindowLog::WindowLog(std::filesystem::path path, const nlohmann::json& header, bool resume)
    : path_(std::move(path)) {
  std::error_code none;
  if (resume && std::filesystem::exists(path_, none)) {
    std::ifstream in(path_, std::ios::binary);
    std::string magic(kMagic.size(), '\0');
    if (!in.read(magic.data(), static_cast<std::streamsize>(magic.size())) || magic != kMagic) {
      throw InputError(path_.string(), "byte 0", "no log of a drive's windows");
    }
    auto end = in.tellg();
    bool begun = false;
    while (auto record = next_record(in)) {
      if (record->kind == 'H') {
        require_equal_header(path_.parent_path(), nlohmann::json::from_cbor(record->bytes), header);
        begun = true;
      } else if (record->kind == 'F') {
        frames_.push_back(frame_of(record->bytes));
      } else if (record->kind == 'W') {
        references_.push_back(decode_window(record->bytes).reference);
      }
      end = in.tellg();
    }
    in.close();
    if (begun) {
      std::sort(references_.begin(), references_.end());
      std::filesystem::resize_file(path_, static_cast<std::uintmax_t>(end), none);
      out_.open(path_, std::ios::binary | std::ios::app);
      if (none || !out_) throw OutputError(path_.string(), "cannot be written");
      return;
    }
    frames_.clear();
    references_.clear();
  }
  out_.open(path_, std::ios::binary | std::ios::trunc);
  out_.write(kMagic.data(), static_cast<std::streamsize>(kMagic.size()));
  write('H', nlohmann::json::to_cbor(header));
  flush();
}

bool WindowLog::has_window(int reference) const {
  return std::binary_search(references_.begin(), references_.end(), reference);
}

void WindowLog::write(char kind, const std::vector<std::uint8_t>& bytes) {
  const std::uint64_t size = bytes.size();
  const std::string_view held(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const std::string hash = hash_bytes(held);
  out_.put(kind);
  out_.write(reinterpret_cast<const char*>(&size), sizeof size);
  out_.write(held.data(), static_cast<std::streamsize>(held.size()));
  out_.write(hash.data(), static_cast<std::streamsize>(hash.size()));
}

void WindowLog::append(const FrameRecord& frame) {
  write('F', nlohmann::json::to_cbor(nlohmann::json::array(
                 {frame.frame, static_cast<int>(frame.kind), frame.reason, frame.still})));
  frames_.push_back(frame);
}

void WindowLog::append(const WindowMeasurement& window) {
  write('W', encode(window));
  references_.insert(std::upper_bound(references_.begin(), references_.end(), window.reference),
                     window.reference);
}

void WindowLog::flush() {
  out_.flush();
  if (!out_) throw OutputError(path_.string(), "cannot be written");
}

void WindowLog::for_each_window(const std::function<void(WindowMeasurement)>& visit) const {
  std::ifstream in(path_, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(kMagic.size()));
  while (auto record = next_record(in)) {
    if (record->kind == 'W') visit(decode_window(record->bytes));
  }
}

}  // namespace camber
