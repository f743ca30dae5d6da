#pragma once

#include <memory>

#include "camber/cloud/detail/laz/laz_format.h"

namespace camber::laz {

/// A part of a record whose points lie one after the other in a chunk: items of versions 1 and 2.
template <typename Coder>
class PointwiseItem {
 public:
  virtual ~PointwiseItem() = default;
  /// Takes the chunk's first item, which is not coded.
  virtual void start(const unsigned char* item) = 0;
  /// The next one, into or out of the coder.
  virtual void code(Coder& coder, unsigned char* item) = 0;
};

/// @param item  one that is_pointwise()
template <typename Coder>
std::unique_ptr<PointwiseItem<Coder>> make_pointwise_item(const LazItem& item);

}  // namespace camber::laz
