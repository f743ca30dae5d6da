#include "camber/cloud/detail/laz/pointwise_items.h"

#include <algorithm>
#include <vector>

#include "camber/cloud/detail/laz/arithmetic_decoder.h"
#include "camber/cloud/detail/laz/arithmetic_encoder.h"
#include "camber/cloud/detail/laz/item_parts.h"

namespace camber::laz {
namespace {

// Places in the 20 bytes that all points of formats 0 to 5 have.
constexpr std::size_t kIntensity = 12, kReturns = 14, kClass = 15, kAngle = 16, kUser = 17,
                      kSource = 18, kPointSize = 20;

/// The parts of a point that are coded only where they change, as bits of one symbol.
enum Changed : unsigned {
  kSourceChanged = 1,
  kUserChanged = 2,
  kAngleChanged = 4,
  kClassChanged = 8
};

/// A byte by the model that its last value chooses.
template <typename Coder>
void code_by_last(Coder& coder, SymbolModels& models, unsigned char last, unsigned char* byte) {
  *byte = static_cast<unsigned char>(coder.symbol(models[last], *byte));
}

template <typename Coder>
void code_u16(Coder& coder, IntegerModel& model, std::uint16_t last, unsigned context,
              unsigned char* value) {
  const std::int32_t coded =
      model.code(coder, last, context, Coder::kEncoding ? get<std::uint16_t>(value) : 0);
  if constexpr (!Coder::kEncoding) put(value, static_cast<std::uint16_t>(coded));
}

template <typename Coder>
class Point10V2 : public PointwiseItem<Coder> {
 public:
  void start(const unsigned char* item) override { std::memcpy(last_, item, kPointSize); }

  void code(Coder& coder, unsigned char* item) override {
    constexpr unsigned kReturnsChanged = 32, kIntensityChanged = 16;
    unsigned changed = 0;
    if constexpr (Coder::kEncoding) {
      const unsigned context = kReturnContext16[item[kReturns] >> 3 & 7][item[kReturns] & 7];
      const auto differs = [&](std::size_t at, std::size_t size) {
        return std::memcmp(item + at, last_ + at, size) != 0;
      };
      changed =
          (differs(kReturns, 1) ? kReturnsChanged : 0u) |
          (get<std::uint16_t>(item + kIntensity) != intensity_[context] ? kIntensityChanged : 0u) |
          (differs(kClass, 1) ? kClassChanged : 0u) | (differs(kAngle, 1) ? kAngleChanged : 0u) |
          (differs(kUser, 1) ? kUserChanged : 0u) | (differs(kSource, 2) ? kSourceChanged : 0u);
    }
    changed = coder.symbol(changed_, changed);
    if constexpr (!Coder::kEncoding) std::memcpy(item, last_, kPointSize);
    if ((changed & kReturnsChanged) != 0) {
      code_by_last(coder, returns_, last_[kReturns], item + kReturns);
    }
    const unsigned number = item[kReturns] & 7, returns = item[kReturns] >> 3 & 7;
    const unsigned context = kReturnContext16[returns][number];
    if ((changed & kIntensityChanged) != 0) {
      code_u16(coder, intensities_, intensity_[context], std::min(context, 3u), item + kIntensity);
      intensity_[context] = get<std::uint16_t>(item + kIntensity);
    } else if constexpr (!Coder::kEncoding) {
      put(item + kIntensity, intensity_[context]);
    }
    if ((changed & kClassChanged) != 0) {
      code_by_last(coder, classes_, last_[kClass], item + kClass);
    }
    if ((changed & kAngleChanged) != 0) {
      const unsigned step = coder.symbol(angles_[item[kReturns] >> 6 & 1],
                                         static_cast<unsigned>(item[kAngle] - last_[kAngle]) & 255);
      if constexpr (!Coder::kEncoding) {
        item[kAngle] = static_cast<unsigned char>(last_[kAngle] + step);
      }
    }
    if ((changed & kUserChanged) != 0) code_by_last(coder, users_, last_[kUser], item + kUser);
    if ((changed & kSourceChanged) != 0) {
      code_u16(coder, sources_, get<std::uint16_t>(last_ + kSource), 0, item + kSource);
    }
    const bool single = returns == 1;
    xyz_.code_xy(coder, median_x_[context], median_y_[context], single, last_, item);
    xyz_.code_z(coder, &z_[return_level(returns, number)], single, item);
    std::memcpy(last_, item, kPointSize);
  }

 private:
  unsigned char last_[kPointSize] = {};
  std::array<std::uint16_t, 16> intensity_{};
  std::array<RunningMedian, 16> median_x_, median_y_;
  std::array<std::int32_t, 8> z_{};
  SymbolModel changed_{64};
  SymbolModels returns_{256, 256}, classes_{256, 256}, users_{256, 256}, angles_{2, 256};
  IntegerModel intensities_{16, 4}, sources_{16};
  CoordinateModels xyz_;
};

template <typename Coder>
class Point10V1 : public PointwiseItem<Coder> {
 public:
  void start(const unsigned char* item) override { std::memcpy(last_, item, kPointSize); }

  void code(Coder& coder, unsigned char* item) override {
    constexpr unsigned kMostContext = 19;
    const std::int32_t x_step = x_.code(
        coder, median(x_steps_), 0, difference(get<std::int32_t>(item), get<std::int32_t>(last_)));
    const std::int32_t y_step =
        y_.code(coder, median(y_steps_), std::min(x_.width(), kMostContext),
                difference(get<std::int32_t>(item + 4), get<std::int32_t>(last_ + 4)));
    const unsigned width = (x_.width() + y_.width()) / 2;
    const std::int32_t z = z_.code(coder, get<std::int32_t>(last_ + 8),
                                   std::min(width, kMostContext), get<std::int32_t>(item + 8));
    constexpr unsigned kIntensityChanged = 32, kReturnsChanged = 16;
    unsigned changed = 0;
    if constexpr (Coder::kEncoding) {
      const auto differs = [&](std::size_t at, std::size_t size) {
        return std::memcmp(item + at, last_ + at, size) != 0;
      };
      changed =
          (differs(kIntensity, 2) ? kIntensityChanged : 0u) |
          (differs(kReturns, 1) ? kReturnsChanged : 0u) |
          (differs(kClass, 1) ? kClassChanged : 0u) | (differs(kAngle, 1) ? kAngleChanged : 0u) |
          (differs(kUser, 1) ? kUserChanged : 0u) | (differs(kSource, 2) ? kSourceChanged : 0u);
    }
    changed = coder.symbol(changed_, changed);
    if constexpr (!Coder::kEncoding) {
      std::memcpy(item, last_, kPointSize);
      put(item, sum(get<std::int32_t>(last_), x_step));
      put(item + 4, sum(get<std::int32_t>(last_ + 4), y_step));
      put(item + 8, z);
    }
    if ((changed & kIntensityChanged) != 0) {
      code_u16(coder, intensities_, get<std::uint16_t>(last_ + kIntensity), 0, item + kIntensity);
    }
    if ((changed & kReturnsChanged) != 0) {
      code_by_last(coder, returns_, last_[kReturns], item + kReturns);
    }
    if ((changed & kClassChanged) != 0) {
      code_by_last(coder, classes_, last_[kClass], item + kClass);
    }
    if ((changed & kAngleChanged) != 0) {
      item[kAngle] = static_cast<unsigned char>(
          angles_.code(coder, last_[kAngle], width < 3 ? 1 : 0, item[kAngle]));
    }
    if ((changed & kUserChanged) != 0) code_by_last(coder, users_, last_[kUser], item + kUser);
    if ((changed & kSourceChanged) != 0) {
      code_u16(coder, sources_, get<std::uint16_t>(last_ + kSource), 0, item + kSource);
    }
    x_steps_[oldest_] = x_step;
    y_steps_[oldest_] = y_step;
    oldest_ = (oldest_ + 1) % 3;
    std::memcpy(last_, item, kPointSize);
  }

 private:
  static std::int32_t median(const std::array<std::int32_t, 3>& v) {
    return std::max(std::min(v[0], v[1]), std::min(std::max(v[0], v[1]), v[2]));
  }

  unsigned char last_[kPointSize] = {};
  std::array<std::int32_t, 3> x_steps_{}, y_steps_{};
  std::size_t oldest_ = 0;
  IntegerModel x_{32}, y_{32, 20}, z_{32, 20}, intensities_{16}, angles_{8, 2}, sources_{16};
  SymbolModel changed_{64};
  SymbolModels returns_{256, 256}, classes_{256, 256}, users_{256, 256};
};

template <typename Coder>
class TimeV2 : public PointwiseItem<Coder> {
 public:
  void start(const unsigned char* item) override { models_.start(get<std::int64_t>(item)); }
  void code(Coder& coder, unsigned char* item) override {
    put(item, models_.code(coder, Coder::kEncoding ? get<std::int64_t>(item) : 0));
  }

 private:
  TimeModels models_{true};
};

/// One sequence of times, whose steps are multiples 0 to 509 of the usual one.
template <typename Coder>
class TimeV1 : public PointwiseItem<Coder> {
 public:
  void start(const unsigned char* item) override { last_ = get<std::int64_t>(item); }

  void code(Coder& coder, unsigned char* item) override {
    std::int64_t time = 0, step = 0;
    if constexpr (Coder::kEncoding) {
      time = get<std::int64_t>(item);
      step = static_cast<std::int64_t>(static_cast<std::uint64_t>(time) -
                                       static_cast<std::uint64_t>(last_));
    }
    if (usual_ == 0) {
      code_first(coder, time, step);
    } else {
      code_multiple(coder, time, step);
    }
    if constexpr (!Coder::kEncoding) put(item, last_);
  }

 private:
  static constexpr unsigned kMost = 509, kFull = 510, kSame = 511;

  static bool fits(std::int64_t step) { return step == static_cast<std::int32_t>(step); }
  void go(std::int32_t step) {
    last_ = static_cast<std::int64_t>(static_cast<std::uint64_t>(last_) +
                                      static_cast<std::uint64_t>(std::int64_t{step}));
  }

  void code_first(Coder& coder, std::int64_t time, std::int64_t step) {
    const unsigned kind = coder.symbol(first_, step == 0 ? 0 : fits(step) ? 1 : 2);
    if (kind == 1) {
      usual_ = steps_.code(coder, 0, 0, static_cast<std::int32_t>(step));
      go(usual_);
    } else if (kind == 2) {
      last_ = static_cast<std::int64_t>(coder.bits64(static_cast<std::uint64_t>(time)));
    }
  }

  void code_multiple(Coder& coder, std::int64_t time, std::int64_t step) {
    unsigned kind = kSame;
    if constexpr (Coder::kEncoding) {
      if (step != 0 && fits(step)) {
        const float multiple = static_cast<float>(step) / static_cast<float>(usual_) + 0.5f;
        kind = !(multiple > 0.0f)    ? 0
               : !(multiple < kMost) ? kMost
                                     : static_cast<unsigned>(multiple);
      } else if (step != 0) {
        kind = kFull;
      }
    }
    kind = coder.symbol(multiple_, kind);
    if (kind == kSame) return;
    if (kind == kFull) {
      last_ = static_cast<std::int64_t>(coder.bits64(static_cast<std::uint64_t>(time)));
      return;
    }
    const unsigned context = kind == 1 ? 1 : kind == 0 ? 2 : kind < 10 ? 3 : kind < 50 ? 4 : 5;
    const std::int32_t predicted =
        kind == 0 ? usual_ / 4 : product(usual_, static_cast<std::int32_t>(kind));
    const std::int32_t coded =
        steps_.code(coder, predicted, context, static_cast<std::int32_t>(step));
    go(coded);
    if (kind == 1) {
      usual_ = coded;
      extremes_ = 0;
    } else if ((kind == 0 || kind == kMost) && ++extremes_ > 3) {
      usual_ = coded;
      extremes_ = 0;
    }
  }

  std::int64_t last_ = 0;
  std::int32_t usual_ = 0;
  int extremes_ = 0;
  SymbolModel first_{3}, multiple_{512};
  IntegerModel steps_{32, 6};
};

template <typename Coder>
class ColorV2 : public PointwiseItem<Coder> {
 public:
  void start(const unsigned char* item) override { std::memcpy(last_, item, sizeof last_); }
  void code(Coder& coder, unsigned char* item) override {
    models_.code(coder, last_, item);
    std::memcpy(last_, item, sizeof last_);
  }

 private:
  unsigned char last_[6] = {};
  ColorModels models_;
};

/// Bytes by the last ones; of colours those that changed.
template <typename Coder>
class BytesV1 : public PointwiseItem<Coder> {
 public:
  BytesV1(std::size_t size, bool color)
      : last_(size), color_(color), changed_(64), bytes_(8, static_cast<unsigned>(size)) {}

  void start(const unsigned char* item) override { std::copy_n(item, last_.size(), last_.begin()); }
  void code(Coder& coder, unsigned char* item) override {
    unsigned changed = 0;
    if (color_) {
      if constexpr (Coder::kEncoding) {
        for (unsigned i = 0; i < 6; ++i) changed |= (last_[i] != item[i] ? 1u : 0u) << i;
      }
      changed = coder.symbol(changed_, changed);
    }
    for (unsigned i = 0; i < last_.size(); ++i) {
      if (!color_ || (changed & 1u << i) != 0) {
        item[i] = static_cast<unsigned char>(bytes_.code(coder, last_[i], i, item[i]));
      } else if constexpr (!Coder::kEncoding) {
        item[i] = last_[i];
      }
      last_[i] = item[i];
    }
  }

 private:
  std::vector<unsigned char> last_;
  bool color_;
  SymbolModel changed_;
  IntegerModel bytes_;
};

template <typename Coder>
class BytesV2 : public PointwiseItem<Coder> {
 public:
  explicit BytesV2(std::size_t size) : last_(size), models_(size, 256) {}

  void start(const unsigned char* item) override { std::copy_n(item, last_.size(), last_.begin()); }
  void code(Coder& coder, unsigned char* item) override {
    for (std::size_t i = 0; i < last_.size(); ++i) {
      const unsigned step =
          coder.symbol(models_[i], static_cast<unsigned>(item[i] - last_[i]) & 255);
      last_[i] = static_cast<unsigned char>(last_[i] + step);
      item[i] = last_[i];
    }
  }

 private:
  std::vector<unsigned char> last_;
  SymbolModels models_;
};

template <typename Coder>
class WavePacketV1 : public PointwiseItem<Coder> {
 public:
  void start(const unsigned char* item) override { std::memcpy(last_, item, sizeof last_); }
  void code(Coder& coder, unsigned char* item) override {
    models_.code(coder, last_, item);
    std::memcpy(last_, item, sizeof last_);
  }

 private:
  unsigned char last_[29] = {};
  WavePacketModels models_;
};

}  // namespace

template <typename Coder>
std::unique_ptr<PointwiseItem<Coder>> make_pointwise_item(const LazItem& item) {
  const bool first = item.version == 1;
  switch (item.type) {
    case LazItem::kPoint10:
      if (first) return std::make_unique<Point10V1<Coder>>();
      return std::make_unique<Point10V2<Coder>>();
    case LazItem::kTime:
      if (first) return std::make_unique<TimeV1<Coder>>();
      return std::make_unique<TimeV2<Coder>>();
    case LazItem::kColor:
      if (first) return std::make_unique<BytesV1<Coder>>(6, true);
      return std::make_unique<ColorV2<Coder>>();
    case LazItem::kWavePacket:
      return std::make_unique<WavePacketV1<Coder>>();
    default:
      break;
  }
  if (first) return std::make_unique<BytesV1<Coder>>(item.size, false);
  return std::make_unique<BytesV2<Coder>>(item.size);
}

template std::unique_ptr<PointwiseItem<ArithmeticDecoder>> make_pointwise_item(const LazItem&);
template std::unique_ptr<PointwiseItem<ArithmeticEncoder>> make_pointwise_item(const LazItem&);

}  // namespace camber::laz
