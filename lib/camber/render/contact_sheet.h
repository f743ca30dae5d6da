#pragma once

#include <string>
#include <vector>

#include "camber/image/image_io.h"

namespace camber {

struct ContactSheetOptions {
  int columns = 0;   ///< 0: so many that the sheet comes nearest to 3 : 2
  int width = 2400;  ///< pixels at most of the sheet, 64 to 16384; pictures are never enlarged

  void validate() const;  ///< throws std::invalid_argument
};

/// Pictures of one size, shrunk, in rows and columns, each with a caption below.
class ContactSheet {
 public:
  /// @param count  pictures that will come, > 0.
  ContactSheet(int count, const ContactSheetOptions& options = {});

  /// @throws std::invalid_argument for one more than `count`, or another size than the first.
  void add(const Image& picture, const std::string& caption);

  const Image& sheet() const { return sheet_; }
  int columns() const { return columns_; }

 private:
  int count_, added_ = 0;
  ContactSheetOptions options_;
  int columns_ = 0, width_ = 0, height_ = 0, cell_width_ = 0, cell_height_ = 0, gap_ = 0;
  double text_size_ = 0.0;
  Image sheet_;
};

}  // namespace camber
