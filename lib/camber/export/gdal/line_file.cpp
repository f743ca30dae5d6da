#include "camber/export/gdal/line_file.h"

#include <cpl_conv.h>
#include <cpl_error.h>
#include <fmt/format.h>
#include <gdal.h>
#include <ogr_api.h>
#include <ogr_srs_api.h>
#include <ogrsf_frmts.h>

#include <cmath>
#include <limits>
#include <memory>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

constexpr std::size_t kMost = 4000000;  // places of a file

struct CloseDataset {
  void operator()(void* dataset) const { GDALClose(dataset); }
};
struct DestroyFeature {
  void operator()(OGRFeatureH feature) const { OGR_F_Destroy(feature); }
};
struct DestroyGeometry {
  void operator()(OGRGeometryH geometry) const { OGR_G_DestroyGeometry(geometry); }
};

class Reader {
 public:
  explicit Reader(const std::string& path) : path_(path) {}
  VectorLines read();

 private:
  void read_layer(OGRLayerH layer);
  void add(OGRGeometryH geometry, const VectorLine& like);
  void join_parts(std::size_t first);

  const std::string& path_;
  VectorLines out_;
  std::size_t places_ = 0;
  bool has_system_ = false;
};

void Reader::add(OGRGeometryH geometry, const VectorLine& like) {
  const OGRwkbGeometryType type = wkbFlatten(OGR_G_GetGeometryType(geometry));
  if (type == wkbLineString) {
    VectorLine line = like;
    const int count = OGR_G_GetPointCount(geometry);
    places_ += static_cast<std::size_t>(count);
    if (places_ > kMost) {
      throw InputError(path_,
                       fmt::format("found more than {} places, expected one site's lines", kMost));
    }
    const bool heights = OGR_G_Is3D(geometry) != 0;
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector3d place(
          OGR_G_GetX(geometry, i), OGR_G_GetY(geometry, i),
          heights ? OGR_G_GetZ(geometry, i) : std::numeric_limits<double>::quiet_NaN());
      if (!place.head<2>().allFinite()) {
        throw InputError(path_, fmt::format("layer {}: found a place that is not finite, expected "
                                            "numbers",
                                            like.layer));
      }
      line.points.push_back(place);
    }
    if (line.points.size() >= 2) out_.lines.push_back(std::move(line));
    return;
  }
  if (type == wkbPolygon || type == wkbPoint) return;
  for (int i = 0; i < OGR_G_GetGeometryCount(geometry); ++i) {
    add(OGR_G_GetGeometryRef(geometry, i), like);
  }
}

/// Parts of one feature whose ends meet, in their order, as one line.
void Reader::join_parts(std::size_t first) {
  for (std::size_t i = first; i + 1 < out_.lines.size();) {
    std::vector<Eigen::Vector3d>&here = out_.lines[i].points, &next = out_.lines[i + 1].points;
    if ((here.back() - next.front()).head<2>().norm() >
        1e-9 * (1.0 + here.back().head<2>().norm())) {
      ++i;
      continue;
    }
    here.insert(here.end(), next.begin() + 1, next.end());
    out_.lines.erase(out_.lines.begin() + static_cast<std::ptrdiff_t>(i) + 1);
  }
}

void Reader::read_layer(OGRLayerH layer) {
  VectorLine like;
  like.layer = OGR_L_GetName(layer);
  OGRFeatureDefnH fields = OGR_L_GetLayerDefn(layer);
  int name_field = -1;
  for (int i = 0; i < OGR_FD_GetFieldCount(fields) && name_field < 0; ++i) {
    const std::string field = lower_case(OGR_Fld_GetNameRef(OGR_FD_GetFieldDefn(fields, i)));
    if (field == "name") name_field = i;
  }
  const std::size_t before = out_.lines.size();
  OGR_L_ResetReading(layer);
  while (true) {
    const std::unique_ptr<void, DestroyFeature> feature(OGR_L_GetNextFeature(layer));
    if (!feature) break;
    OGRGeometryH given = OGR_F_GetGeometryRef(feature.get());
    if (!given) continue;
    like.name = name_field >= 0 ? OGR_F_GetFieldAsString(feature.get(), name_field) : "";
    // Chords no more than 0.25 degrees apart.
    const std::unique_ptr<void, DestroyGeometry> linear(
        OGR_G_GetLinearGeometry(given, 0.25, nullptr));
    const std::size_t first = out_.lines.size();
    add(linear ? linear.get() : given, like);
    join_parts(first);
  }
  if (CPLGetLastErrorType() >= CE_Failure) {
    throw InputError(path_, fmt::format("layer {}: GDAL: {}", like.layer, CPLGetLastErrorMsg()));
  }
  if (out_.lines.size() == before) return;
  std::string crs;
  if (OGRSpatialReferenceH system = OGR_L_GetSpatialRef(layer)) {
    char* text = nullptr;
    if (OSRExportToWkt(system, &text) == OGRERR_NONE && text) crs = text;
    CPLFree(text);
  }
  if (has_system_ && crs != out_.crs) {
    throw InputError(path_, fmt::format("layer {}: found another coordinate system than in the "
                                        "layers before, expected one",
                                        like.layer));
  }
  out_.crs = crs;
  has_system_ = true;
}

VectorLines Reader::read() {
  CPLPushErrorHandler(CPLQuietErrorHandler);
  RegisterOGRGeoJSON();
  RegisterOGRGeoPackage();
  RegisterOGRShape();
  RegisterOGRDXF();
  const std::unique_ptr<void, CloseDataset> dataset(
      GDALOpenEx(path_.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY, nullptr, nullptr, nullptr));
  if (!dataset) {
    const std::string reason = CPLGetLastErrorMsg();
    throw InputError(path_, fmt::format("found no GeoJSON, GeoPackage, Shapefile or DXF that GDAL "
                                        "reads{}{}, expected one",
                                        reason.empty() ? "" : ": ", reason));
  }
  CPLErrorReset();
  for (int i = 0; i < GDALDatasetGetLayerCount(dataset.get()); ++i) {
    read_layer(GDALDatasetGetLayer(dataset.get(), i));
  }
  CPLPopErrorHandler();
  if (out_.lines.empty()) throw InputError(path_, "found no line, expected one");
  return std::move(out_);
}

}  // namespace

VectorLines read_vector_lines(const std::string& path) { return Reader(path).read(); }

}  // namespace camber
