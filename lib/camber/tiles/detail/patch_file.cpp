#include "camber/tiles/detail/patch_file.h"

#include <fmt/format.h>

#include <cstring>
#include <type_traits>

#include "camber/core/errors.h"

namespace camber::detail {
namespace {

constexpr char kPatches[] = "CamberTilePatch1", kIds[] = "CamberPatchIds01";
constexpr std::size_t kMagic = 16;

/// Every struct's fields are named once, for both ways.
class Writer {
 public:
  template <class T>
  void number(T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  void text(std::string& value) {
    std::uint64_t size = value.size();
    number(size);
    bytes += value;
  }
  template <class T>
  void size(std::vector<T>& list, std::size_t) {
    std::uint64_t count = list.size();
    number(count);
  }
  std::string bytes;
};

class Reader {
 public:
  Reader(const std::string& bytes, const std::string& name, const char* magic)
      : bytes_(bytes), name_(name), at_(kMagic) {
    if (bytes.compare(0, kMagic, magic) != 0) {
      throw InputError(name, "byte 0: found no file of this version that tiles run wrote");
    }
  }
  template <class T>
  void number(T& value) {
    std::memcpy(&value, take(sizeof(T)), sizeof(T));
  }
  void text(std::string& value) {
    const std::size_t length = count(1);
    value.assign(take(length), length);
  }
  template <class T>
  void size(std::vector<T>& list, std::size_t least) {
    list.resize(count(least));
  }
  void finish() const {
    if (at_ != bytes_.size()) {
      throw InputError(
          name_, fmt::format("byte {}: found {} bytes behind the end", at_, bytes_.size() - at_));
    }
  }

 private:
  const char* take(std::size_t size) {
    if (size > bytes_.size() - at_) {
      throw InputError(
          name_, fmt::format("byte {}: found the end of the file, expected {} bytes", at_, size));
    }
    const char* out = bytes_.data() + at_;
    at_ += size;
    return out;
  }
  /// Of items that take at least so many bytes each.
  std::size_t count(std::size_t least) {
    std::uint64_t value = 0;
    number(value);
    if (value > (bytes_.size() - at_) / least) {
      throw InputError(name_, fmt::format("byte {}: found a list of {}, expected no more than fit",
                                          at_ - sizeof(value), value));
    }
    return static_cast<std::size_t>(value);
  }

  const std::string& bytes_;
  const std::string& name_;
  std::size_t at_;
};

template <class Archive, class Derived>
void matrix(Archive& archive, Eigen::MatrixBase<Derived>& value) {
  for (Eigen::Index k = 0; k < value.size(); ++k) archive.number(value.derived().data()[k]);
}

template <class Archive>
void moments(Archive& archive, plane_kernels::Moments& m) {
  for (double* value : {&m.weight, &m.u, &m.v, &m.uu, &m.uv, &m.vv, &m.r, &m.ru, &m.rv, &m.count,
                        &m.i1, &m.iu, &m.iv, &m.iuu, &m.iuv, &m.ivv}) {
    archive.number(*value);
  }
}

template <class Archive>
void piece(Archive& archive, PlanePatch& patch, PatchSums& sums) {
  archive.number(patch.id);
  archive.number(patch.status);
  archive.text(patch.reason);
  matrix(archive, patch.plane.plane.normal);
  archive.number(patch.plane.plane.offset);
  matrix(archive, patch.plane.centroid);
  matrix(archive, patch.plane.axis1);
  matrix(archive, patch.plane.axis2);
  matrix(archive, patch.plane.covariance);
  archive.number(patch.inliers);
  archive.number(patch.noise);
  archive.number(patch.unmodelled_sigma);
  for (Eigen::Vector3d* v : {&sums.center, &sums.a, &sums.b, &sums.normal}) matrix(archive, *v);
  moments(archive, sums.fit);
  moments(archive, sums.influence);
  archive.number(sums.errors.noise);
  archive.number(sums.errors.places);
  archive.number(sums.errors.shared);
  char has_rays = sums.rays ? 1 : 0;
  archive.number(has_rays);
  if (has_rays != 0) {
    if (!sums.rays) sums.rays.emplace();
    archive.number(sums.rays->rise);
    archive.number(sums.rays->slope_u);
    archive.number(sums.rays->slope_v);
  }
  archive.size(sums.outline, 2 * sizeof(double));
  for (Eigen::Vector2d& corner : sums.outline) matrix(archive, corner);
}

template <class Archive>
void block(Archive& archive, PatchBlock& b) {
  archive.number(b.row);
  archive.number(b.column);
  archive.number(b.height);
  archive.number(b.tolerance);
  archive.number(b.local_noise);
  archive.text(b.reason);
  archive.size(b.pieces, 500);
  b.sums.resize(b.pieces.size());
  for (std::size_t k = 0; k < b.pieces.size(); ++k) piece(archive, b.pieces[k], b.sums[k]);
  std::vector<std::array<std::int32_t, 3>> borders;
  for (const auto& [pair, number] : b.borders) borders.push_back({pair.first, pair.second, number});
  archive.size(borders, 3 * sizeof(std::int32_t));
  for (auto& border : borders) {
    for (std::int32_t& value : border) archive.number(value);
    b.borders[{border[0], border[1]}] = border[2];
  }
  for (std::vector<std::int32_t>& side : b.beside) {
    archive.size(side, sizeof(std::int32_t));
    for (std::int32_t& label : side) archive.number(label);
  }
}

template <class Archive>
void patches(Archive& archive, TilePatches& p) {
  archive.size(p.blocks, 64);
  for (PatchBlock& b : p.blocks) block(archive, b);
  archive.size(p.labels, sizeof(std::int32_t));
  for (std::int32_t& label : p.labels) archive.number(label);
}

template <class Archive>
void all_ids(Archive& archive, PieceIds& ids) {
  archive.size(ids.blocks, 24);
  for (PieceIds::Block& b : ids.blocks) {
    archive.number(b.row);
    archive.number(b.column);
    archive.size(b.ids, sizeof(std::int32_t));
    for (std::int32_t& id : b.ids) archive.number(id);
  }
}

/// A file whose numbers lead out of its own lists.
[[noreturn]] void fail(const std::string& name, const PatchBlock& b, const char* what) {
  throw InputError(name,
                   fmt::format("block {} {}: found {} that is not there", b.column, b.row, what));
}

void check(const TilePatches& p, const std::string& name) {
  std::size_t pieces = 0;
  for (const PatchBlock& b : p.blocks) {
    const auto count = static_cast<int>(b.pieces.size());
    pieces += b.pieces.size();
    for (const auto& [pair, number] : b.borders) {
      if (pair.first < 0 || pair.second < 0 || pair.first >= count || pair.second >= count) {
        fail(name, b, "the border of a piece");
      }
    }
    for (const auto& side : b.beside) {
      for (const std::int32_t label : side) {
        if (label < -1 || label >= count) fail(name, b, "a piece beside a border");
      }
    }
  }
  for (const std::int32_t label : p.labels) {
    if (label < -1 || (label >= 0 && static_cast<std::size_t>(label) >= pieces)) {
      throw InputError(name,
                       fmt::format("found a point of piece {}, expected one of {}", label, pieces));
    }
  }
}

}  // namespace

std::string encode_patches(const TilePatches& p) {
  Writer writer;
  writer.bytes.assign(kPatches, kMagic);
  patches(writer, const_cast<TilePatches&>(p));  // a writer changes nothing
  return std::move(writer.bytes);
}

TilePatches decode_patches(const std::string& bytes, const std::string& name) {
  TilePatches out;
  Reader reader(bytes, name, kPatches);
  patches(reader, out);
  reader.finish();
  check(out, name);
  return out;
}

std::string encode_ids(const PieceIds& ids) {
  Writer writer;
  writer.bytes.assign(kIds, kMagic);
  all_ids(writer, const_cast<PieceIds&>(ids));
  return std::move(writer.bytes);
}

PieceIds decode_ids(const std::string& bytes, const std::string& name) {
  PieceIds out;
  Reader reader(bytes, name, kIds);
  all_ids(reader, out);
  reader.finish();
  return out;
}

}  // namespace camber::detail
