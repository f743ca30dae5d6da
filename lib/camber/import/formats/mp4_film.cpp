#include "camber/import/formats/mp4_film.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <string_view>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr std::uint64_t kMostHeader = std::uint64_t{1} << 28;  // bytes, of a film's tables
constexpr int kMostBoxes = 1 << 20;                            // of a file, one behind the other
constexpr std::uint64_t kMostPayloads = 1 << 20;
constexpr double kFrom1904To1970 = 2082844800.0;  // s

std::uint64_t big_endian(std::string_view bytes) {
  std::uint64_t out = 0;
  for (const char byte : bytes) out = (out << 8) | static_cast<unsigned char>(byte);
  return out;
}

/// The content of a box, held in memory.
struct Box {
  std::string type;
  std::string_view body;
  std::uint64_t at = 0;  // of the body in the file
};

class MovieHeader {
 public:
  MovieHeader(const fs::path& path, std::uint64_t file_size) : path_(path), size_(file_size) {}

  Mp4Film read(const Box& moov) const {
    Mp4Film out;
    std::uint64_t movie_scale = 0;
    std::vector<Box> tracks;
    for (const Box& box : children(moov)) {
      if (box.type == "mvhd") {
        const Clock clock = clock_of(box);
        movie_scale = clock.per_second;
        const double created = static_cast<double>(clock.created) - kFrom1904To1970;
        if (created > 0.0) out.created_s = created;
      }
      if (box.type == "trak") tracks.push_back(box);
    }
    double first_frame = 0.0;  // on the film's time line
    bool has_video = false;
    for (const Box& track : tracks) {
      if (has_video || handler_of(track) != "vide") continue;
      first_frame = edit_of(track, movie_scale).empty_s;
      has_video = true;
    }
    for (const Box& track : tracks) {
      if (!out.telemetry.empty() || !is_telemetry(track)) continue;
      out.telemetry = payloads_of(track, edit_of(track, movie_scale), first_frame);
    }
    return out;
  }

 private:
  struct Clock {
    std::uint64_t created = 0, per_second = 0;
  };
  /// The start of a track: how long nothing is shown, then from which of its times on.
  struct Edit {
    double empty_s = 0.0;
    std::int64_t media_time = 0;
  };

  [[noreturn]] void fail(std::uint64_t at, const std::string& reason) const {
    throw InputError(path_.string(), fmt::format("byte {}", at), reason);
  }

  std::uint64_t number(const Box& box, std::uint64_t from, std::uint64_t bytes) const {
    if (from > box.body.size() || bytes > box.body.size() - from) {
      fail(box.at + from,
           fmt::format("found the end of a box '{}' of {} bytes, expected {} bytes more",
                       printable(box.type), box.body.size(), bytes));
    }
    return big_endian(box.body.substr(from, bytes));
  }

  std::vector<Box> children(const Box& parent) const {
    std::vector<Box> out;
    std::uint64_t at = 0;
    while (at + 8 <= parent.body.size()) {
      std::uint64_t size = number(parent, at, 4), header = 8;
      const std::string type(parent.body.substr(at + 4, 4));
      if (size == 0 && type == std::string(4, '\0')) break;  // QuickTime ends lists so
      if (size == 1) {
        size = number(parent, at + 8, 8);
        header = 16;
      }
      const std::uint64_t left = parent.body.size() - at;
      if (size < header || size > left) {
        fail(parent.at + at, fmt::format("found a box '{}' of {} bytes in the last {} of '{}', "
                                         "expected it within",
                                         printable(type), size, left, printable(parent.type)));
      }
      out.push_back(
          {type, parent.body.substr(at + header, size - header), parent.at + at + header});
      at += size;
    }
    return out;
  }

  std::optional<Box> child(const Box& parent, const std::string& type) const {
    for (Box& box : children(parent)) {
      if (box.type == type) return std::move(box);
    }
    return std::nullopt;
  }

  std::optional<Box> descendant(const Box& parent, std::initializer_list<const char*> types) const {
    std::optional<Box> at = parent;
    for (const char* type : types) {
      if (at) at = child(*at, type);
    }
    return at;
  }

  Clock clock_of(const Box& box) const {
    const std::uint64_t wide = number(box, 0, 1) == 1 ? 8 : 4;
    Clock out;
    out.created = number(box, 4, wide);
    out.per_second = number(box, 4 + 2 * wide, 4);
    if (out.per_second == 0) {
      fail(box.at + 4 + 2 * wide,
           fmt::format("found a '{}' of 0 units a second, expected some", box.type));
    }
    return out;
  }

  std::string handler_of(const Box& track) const {
    const auto box = descendant(track, {"mdia", "hdlr"});
    if (!box) return {};
    number(*box, 8, 4);
    return std::string(box->body.substr(8, 4));
  }

  bool is_telemetry(const Box& track) const {
    if (handler_of(track) != "meta") return false;
    const auto box = descendant(track, {"mdia", "minf", "stbl", "stsd"});
    if (!box) return false;
    number(*box, 12, 4);
    return box->body.substr(12, 4) == "gpmd";
  }

  Edit edit_of(const Box& track, std::uint64_t movie_scale) const {
    Edit out;
    const auto list = descendant(track, {"edts", "elst"});
    if (!list || movie_scale == 0) return out;
    const std::uint64_t wide = number(*list, 0, 1) == 1 ? 8 : 4, entry = 2 * wide + 4;
    const std::uint64_t count = table_size(*list, 4, entry, 8);
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::uint64_t length = number(*list, 8 + i * entry, wide);
      const std::uint64_t raw = number(*list, 8 + i * entry + wide, wide);
      const std::int64_t media_time =
          wide == 8 ? static_cast<std::int64_t>(raw)
                    : static_cast<std::int32_t>(static_cast<std::uint32_t>(raw));
      if (media_time >= 0) {
        out.media_time = media_time;
        break;
      }
      out.empty_s += static_cast<double>(length) / static_cast<double>(movie_scale);
    }
    return out;
  }

  /// How many entries a table states, at `from`, that begin at `first`.
  std::uint64_t table_size(const Box& box, std::uint64_t from, std::uint64_t entry,
                           std::uint64_t first) const {
    const std::uint64_t count = number(box, from, 4);
    const std::uint64_t room = box.body.size() < first ? 0 : (box.body.size() - first) / entry;
    if (count > room) {
      fail(box.at + from, fmt::format("found a table '{}' of {} entries in {} bytes, expected "
                                      "at most {}",
                                      printable(box.type), count, box.body.size(), room));
    }
    return count;
  }

  Box table(const Box& stbl, const char* type) const {
    auto out = child(stbl, type);
    if (!out) fail(stbl.at, fmt::format("found no table '{}', expected one", type));
    return std::move(*out);
  }

  std::vector<std::uint64_t> sizes_of(const Box& stbl) const {
    const Box box = table(stbl, "stsz");
    const std::uint64_t same = number(box, 4, 4);
    const std::uint64_t count = same > 0 ? number(box, 8, 4) : table_size(box, 8, 4, 12);
    if (count > kMostPayloads || (same > 0 && count > size_ / same)) {
      fail(box.at + 8, fmt::format("found {} payloads in a file of {} bytes, expected at most {}",
                                   count, size_, kMostPayloads));
    }
    std::vector<std::uint64_t> out(count, same);
    for (std::uint64_t i = 0; same == 0 && i < count; ++i) out[i] = number(box, 12 + 4 * i, 4);
    return out;
  }

  /// Times of the payloads and of the end, in units of the track.
  std::vector<double> times_of(const Box& stbl, std::size_t count) const {
    const Box box = table(stbl, "stts");
    const std::uint64_t entries = table_size(box, 4, 8, 8);
    std::vector<double> out = {0.0};
    for (std::uint64_t i = 0; i < entries; ++i) {
      const std::uint64_t repeat = number(box, 8 + 8 * i, 4);
      const auto step = static_cast<double>(number(box, 12 + 8 * i, 4));
      for (std::uint64_t k = 0; k < repeat && out.size() <= count; ++k) {
        out.push_back(out.back() + step);
      }
    }
    if (out.size() <= count) {
      fail(box.at,
           fmt::format("found times of {} payloads, expected those of {}", out.size() - 1, count));
    }
    return out;
  }

  std::vector<FilmPayload> payloads_of(const Box& track, const Edit& edit,
                                       double first_frame) const {
    const auto mdhd = descendant(track, {"mdia", "mdhd"});
    const auto stbl = descendant(track, {"mdia", "minf", "stbl"});
    if (!mdhd || !stbl) fail(track.at, "found a track without 'mdhd' and 'stbl', expected both");
    const auto per_second = static_cast<double>(clock_of(*mdhd).per_second);
    const std::vector<std::uint64_t> sizes = sizes_of(*stbl);
    const std::vector<double> times = times_of(*stbl, sizes.size());
    const double shift =
        edit.empty_s - static_cast<double>(edit.media_time) / per_second - first_frame;
    const bool wide = child(*stbl, "co64").has_value();
    const std::uint64_t place = wide ? 8 : 4;
    const Box chunks = table(*stbl, wide ? "co64" : "stco");
    const Box groups = table(*stbl, "stsc");
    const std::uint64_t num_chunks = table_size(chunks, 4, place, 8);
    const std::uint64_t num_groups = table_size(groups, 4, 12, 8);
    std::vector<FilmPayload> out;
    std::uint64_t group = 0;
    for (std::uint64_t chunk = 0; chunk < num_chunks && out.size() < sizes.size(); ++chunk) {
      while (group + 1 < num_groups && number(groups, 8 + 12 * (group + 1), 4) <= chunk + 1) {
        ++group;
      }
      const std::uint64_t in_chunk = num_groups > 0 ? number(groups, 12 + 12 * group, 4) : 0;
      std::uint64_t at = number(chunks, 8 + place * chunk, place);
      for (std::uint64_t k = 0; k < in_chunk && out.size() < sizes.size(); ++k) {
        const std::size_t i = out.size();
        if (at > size_ || sizes[i] > size_ - at) {
          fail(chunks.at + 8 + place * chunk,
               fmt::format("found payload {} of {} bytes from byte {} on, expected it within the "
                           "file's {}",
                           i, sizes[i], at, size_));
        }
        out.push_back(
            {at, sizes[i], times[i] / per_second + shift, (times[i + 1] - times[i]) / per_second});
        at += sizes[i];
      }
    }
    if (out.size() < sizes.size()) {
      fail(groups.at, fmt::format("found places of {} payloads, expected those of {}", out.size(),
                                  sizes.size()));
    }
    return out;
  }

  fs::path path_;
  std::uint64_t size_ = 0;  // of the file
};

/// What begins files of this kind.
bool is_first_box(const std::string& type) {
  for (const char* known : {"ftyp", "moov", "mdat", "wide", "free", "skip", "pnot"}) {
    if (type == known) return true;
  }
  return false;
}

}  // namespace

std::optional<Mp4Film> read_mp4_film(const fs::path& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return std::nullopt;
  std::ifstream file = open_file(path);
  file.seekg(0, std::ios::end);
  const auto size = static_cast<std::uint64_t>(std::max<std::streamoff>(0, file.tellg()));
  std::uint64_t at = 0;
  for (int boxes = 0; at + 8 <= size && boxes < kMostBoxes; ++boxes) {
    char bytes[16] = {};
    file.seekg(static_cast<std::streamoff>(at));
    file.read(bytes, 8);
    std::uint64_t length = big_endian({bytes, 4}), header = 8;
    const std::string type(bytes + 4, 4);
    if (boxes == 0 && !is_first_box(type)) return std::nullopt;
    if (length == 1) {
      file.read(bytes + 8, 8);
      length = big_endian({bytes + 8, 8});
      header = 16;
    } else if (length == 0) {
      length = size - at;
    }
    if (!file) break;
    if (length < header || length > size - at) {
      if (type != "moov") break;  // a film that was cut: its pictures' reader says so
      throw InputError(path.string(), fmt::format("byte {}", at),
                       fmt::format("found a header of {} bytes, expected it within the file's {}",
                                   length, size));
    }
    if (type == "moov") {
      if (length > kMostHeader) {
        throw InputError(
            path.string(), fmt::format("byte {}", at),
            fmt::format("found a header of {} bytes, expected at most {}", length, kMostHeader));
      }
      std::string body(length - header, '\0');
      file.read(body.data(), static_cast<std::streamsize>(body.size()));
      if (!file) throw InputError(path.string(), "cannot be read");
      return MovieHeader(path, size).read({type, body, at + header});
    }
    at += length;
  }
  return Mp4Film();
}

}  // namespace camber
