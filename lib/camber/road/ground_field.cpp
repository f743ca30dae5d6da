#include "camber/road/ground_field.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>

#include "camber/core/threads.h"
#include "camber/geometry/detail/dense_product.h"
#include "camber/road/detail/banded_ldlt.h"

namespace camber {
namespace {

/// Change of the cross slope from node to node, however far apart they are: a crown of 4 % to both
/// sides.
constexpr double kCrossBreak = 0.08;

struct Footprint {
  int node[4];
  double weight[4];
};

}  // namespace

struct GroundField::Impl {
  PinholeCamera camera;
  double left = 0, top = 0, du = 1, dv = 1;
  int columns = 0, rows = 0;
  Eigen::VectorXd nodes, node_support;
  detail::SymmetricBand normal;  // of the last solution
  detail::BandedLdlt solver;
  mutable std::mutex posterior_mutex;
  // Made when they are first asked for: the covariances' solver, d(nodes) / d(shared parameters).
  mutable std::optional<detail::SparseLdlt> posterior;
  mutable std::optional<Eigen::MatrixXd> shared;
  // What `shared` solves for: the right sides by shared parameters, a row a node.
  using NodeRows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  NodeRows shared_right;
  std::vector<double> weights;

  const Eigen::MatrixXd& shared_jacobian() const {
    const std::lock_guard<std::mutex> lock(posterior_mutex);
    if (!shared) {
      shared.emplace(Eigen::MatrixXd(shared_right.rows(), shared_right.cols()));
      if (shared_right.cols() > 0) *shared = solver.solve(shared_right);
    }
    return *shared;
  }

  int index(int r, int c) const { return r * columns + c; }

  Footprint footprint(const Eigen::Vector2d& pixel) const {
    const double x = std::clamp((pixel.x() - left) / du, 0.0, columns - 1.001);
    const double y = std::clamp((pixel.y() - top) / dv, 0.0, rows - 1.001);
    const int c = static_cast<int>(x), r = static_cast<int>(y);
    const double ax = x - c, ay = y - r;
    return {{index(r, c), index(r, c + 1), index(r + 1, c), index(r + 1, c + 1)},
            {(1 - ax) * (1 - ay), ax * (1 - ay), (1 - ax) * ay, ax * ay}};
  }

  double value(const Footprint& f, const Eigen::VectorXd& v) const {
    return f.weight[0] * v[f.node[0]] + f.weight[1] * v[f.node[1]] + f.weight[2] * v[f.node[2]] +
           f.weight[3] * v[f.node[3]];
  }
  struct Difference {
    int node[4];
    double sign[4];
    int terms;
    double pixels_u, pixels_v;
    int centre_row, centre_column;
    double weight = 1.0;
  };
  std::vector<Difference> differences;
  GroundFieldOptions options;
  double last_correlation = 1.0;

  /// Columns: functionals of the nodes from those of inverse depths at pixels.
  Eigen::MatrixXd functional(const std::vector<Eigen::Vector2d>& pixels,
                             const Eigen::MatrixXd& coefficients) const {
    if (coefficients.cols() != static_cast<Eigen::Index>(pixels.size())) {
      throw std::invalid_argument("coefficients has " + std::to_string(coefficients.cols()) +
                                  " columns, expected one for each of " +
                                  std::to_string(pixels.size()) + " pixels");
    }
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(nodes.size(), coefficients.rows());
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const Footprint f = footprint(pixels[i]);
      for (int k = 0; k < 4; ++k) {
        out.row(f.node[k]) +=
            f.weight[k] * coefficients.col(static_cast<Eigen::Index>(i)).transpose();
      }
    }
    return out;
  }

  void make_differences() {
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c) {
        if (r + 2 < rows) {
          differences.push_back({{index(r, c), index(r + 1, c), index(r + 2, c), 0},
                                 {1, -2, 1, 0},
                                 3,
                                 0,
                                 dv,
                                 r + 1,
                                 c});
        }
        if (c + 2 < columns) {
          differences.push_back({{index(r, c), index(r, c + 1), index(r, c + 2), 0},
                                 {1, -2, 1, 0},
                                 3,
                                 du,
                                 0,
                                 r,
                                 c + 1});
        }
        if (r + 1 < rows && c + 1 < columns) {
          differences.push_back(
              {{index(r, c), index(r, c + 1), index(r + 1, c), index(r + 1, c + 1)},
               {1, -1, -1, 1},
               4,
               du,
               dv,
               r,
               c});
        }
      }
    }
  }

  /// Standard deviation of a second difference at a node: curvature times the metric step squared,
  /// turned into inverse depth (a rise dh of the plane changes it by rho dh |m|, m = -n / d).
  double spread(const Difference& d) const {
    const double along = options.along_curvature * options.metres_per_baseline;
    const double across = options.across_curvature * options.metres_per_baseline;
    const double longest_step =
        8.0 / options.metres_per_baseline;  // roads do not bend one way for ever
    const double least_inverse_depth = options.metres_per_baseline / 150.0;
    const int r = std::clamp(d.centre_row, 1, rows - 2);
    const int c = std::clamp(d.centre_column, 1, columns - 2);
    const double rho = std::max(nodes[index(r, c)], least_inverse_depth);
    const double rho_u = (nodes[index(r, c + 1)] - nodes[index(r, c - 1)]) / (2 * du);
    const double rho_v = (nodes[index(r + 1, c)] - nodes[index(r - 1, c)]) / (2 * dv);
    const double u = left + c * du - camera.cx, v = top + r * dv - camera.cy;
    const double inverse_height =
        Eigen::Vector3d(rho_u * camera.fx, rho_v * camera.fy, rho - rho_u * u - rho_v * v).norm();
    const double step_along =
        std::min(longest_step, d.pixels_v * std::abs(rho_v) / (rho * rho) + 1e-6);
    const double step_across = std::min(longest_step, d.pixels_u / (camera.fx * rho) + 1e-6);
    double rise;
    if (d.pixels_u == 0) {
      rise = along * step_along * step_along;
    } else if (d.pixels_v == 0) {
      rise = std::min(across * step_across, kCrossBreak) * step_across;
    } else {
      rise = std::sqrt(along * across) * step_along * step_across;
    }
    return std::max(rise * rho * inverse_height, 1e-9);
  }

  /// Observations are worked on in pieces side by side, a fixed number for any number of threads:
  /// their sums are added in order.
  static constexpr std::size_t kPieces = 4;

  template <class Work>
  void in_pieces(std::size_t count, const Work& work) const {
    parallel_for(kPieces, options.num_threads, [&](std::size_t piece) {
      work(piece, count * piece / kPieces, count * (piece + 1) / kPieces);
    });
  }

  /// Cauchy weights of the observations against the field as it is.
  void reweigh(const GroundObservations& observations, const std::vector<Footprint>& footprints,
               double width, std::vector<double>& weight) const {
    in_pieces(observations.size(), [&](std::size_t, std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        const double r =
            (observations.inverse_depth[i] - value(footprints[i], nodes)) / observations.sigma[i];
        weight[i] = 1.0 / (1.0 + r * r / (6.25 * width * width));
      }
    });
  }

  /// The data's share of the normal equations: a dense 4 x 4 block a cell, so that the triplets are
  /// few, and the right side.
  struct DataTerm {
    std::array<std::vector<Eigen::Matrix4d>, kPieces> blocks;  ///< summed in the first
    std::array<Eigen::VectorXd, kPieces> right;
  };

  void accumulate(const GroundObservations& observations, const std::vector<Footprint>& footprints,
                  const std::vector<double>& weight, double correlation, DataTerm& term) const {
    const auto cells = static_cast<std::size_t>((columns - 1) * (rows - 1));
    in_pieces(observations.size(), [&](std::size_t piece, std::size_t first, std::size_t last) {
      std::vector<Eigen::Matrix4d>& part = term.blocks[piece];
      Eigen::VectorXd& side = term.right[piece];
      part.assign(cells, Eigen::Matrix4d::Zero());
      side = Eigen::VectorXd::Zero(columns * rows);
      for (std::size_t i = first; i < last; ++i) {
        const Footprint& f = footprints[i];
        const double w = weight[i] / (correlation * observations.sigma[i] * observations.sigma[i]);
        const int cell = f.node[0] / columns * (columns - 1) + f.node[0] % columns;
        const Eigen::Map<const Eigen::Vector4d> b(f.weight);
        part[static_cast<std::size_t>(cell)].noalias() += (w * b) * b.transpose();
        for (int k = 0; k < 4; ++k) {
          side[f.node[k]] += w * f.weight[k] * observations.inverse_depth[i];
        }
      }
    });
    for (std::size_t piece = 1; piece < kPieces; ++piece) {
      for (std::size_t cell = 0; cell < cells; ++cell) {
        term.blocks[0][cell] += term.blocks[piece][cell];
      }
      term.right[0] += term.right[piece];
    }
  }

  /// Lower triangle of the data's normal matrix.
  void add_data(const std::vector<Eigen::Matrix4d>& blocks, detail::SymmetricBand& matrix) const {
    for (int cell = 0; cell < (columns - 1) * (rows - 1); ++cell) {
      const int r = cell / (columns - 1), c = cell % (columns - 1);
      const int at[4] = {index(r, c), index(r, c + 1), index(r + 1, c), index(r + 1, c + 1)};
      for (int j = 0; j < 4; ++j) {
        for (int k = 0; k <= j; ++k) {
          matrix.at(at[j], at[k]) += blocks[static_cast<std::size_t>(cell)](j, k);
        }
      }
    }
  }

  /// Lower triangle of the smoothness' normal matrix, each difference weighed anew.
  void add_smoothness(detail::SymmetricBand& matrix) {
    for (Difference& d : differences) {
      const double s = spread(d);
      double difference = 0.0;
      for (int k = 0; k < d.terms; ++k) difference += d.sign[k] * nodes[d.node[k]];
      d.weight = 1.0 / (1.0 + difference * difference / (9.0 * s * s));
      const double w = d.weight / (s * s);
      for (int j = 0; j < d.terms; ++j) {
        for (int k = 0; k <= j; ++k) matrix.at(d.node[j], d.node[k]) += w * d.sign[j] * d.sign[k];
      }
    }
  }

  /// Reweighted least squares; `weight` empty: taken from the residuals against the field as it is.
  /// The loss of observations shrinks from first_width to 1 over the iterations.
  void solve(const GroundObservations& observations, std::vector<double> weight, int iterations,
             double first_width, double correlation) {
    const std::size_t count = observations.size();
    if (observations.inverse_depth.size() != count || observations.sigma.size() != count) {
      throw std::invalid_argument("ground observations: arrays differ in length");
    }
    std::vector<Footprint> footprints(count);
    in_pieces(count, [&](std::size_t, std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) footprints[i] = footprint(observations.pixels[i]);
    });
    if (weight.empty()) {
      weight.resize(count);
      reweigh(observations, footprints, first_width, weight);
    }
    posterior.reset();
    shared.reset();
    const int n = columns * rows;
    DataTerm data;
    for (int iteration = 0; iteration < iterations; ++iteration) {
      accumulate(observations, footprints, weight, correlation, data);
      normal.set_zero(n, 2 * columns);  // second differences reach two rows
      add_data(data.blocks[0], normal);
      add_smoothness(normal);
      if (!solver.factorise(normal)) {
        throw std::invalid_argument("ground observations do not fix the field");
      }
      nodes = solver.solve_vector(data.right[0]);
      if (iteration + 1 == iterations) break;
      const double share = (iteration + 1.0) / std::max(1, iterations - 1);
      reweigh(observations, footprints, std::pow(first_width, 1.0 - share), weight);
    }
    keep_posterior(observations, footprints, weight, correlation);
    weights = std::move(weight);
    last_correlation = correlation;
  }

  /// What later queries need of the last solution: support and dependence on shared parameters.
  void keep_posterior(const GroundObservations& observations,
                      const std::vector<Footprint>& footprints, const std::vector<double>& weight,
                      double correlation) {
    const int n = columns * rows;
    const Eigen::Index columns_shared = observations.shared_jacobian.cols();
    std::array<Eigen::VectorXd, kPieces> supports;
    std::array<NodeRows, kPieces> sides;
    in_pieces(observations.size(), [&](std::size_t piece, std::size_t first, std::size_t last) {
      Eigen::VectorXd& support = supports[piece];
      NodeRows& side = sides[piece];
      support.setZero(n);
      side.setZero(n, columns_shared);
      Eigen::RowVectorXd row(columns_shared);
      for (std::size_t i = first; i < last; ++i) {
        const Footprint& f = footprints[i];
        const double w = weight[i] / (correlation * observations.sigma[i] * observations.sigma[i]);
        if (columns_shared > 0) {
          row = w * observations.shared_jacobian.row(static_cast<Eigen::Index>(i)).cast<double>();
        }
        for (int k = 0; k < 4; ++k) {
          support[f.node[k]] += weight[i] * f.weight[k];
          if (columns_shared > 0) side.row(f.node[k]) += f.weight[k] * row;
        }
      }
    });
    node_support = std::move(supports[0]);
    shared_right = std::move(sides[0]);
    for (std::size_t piece = 1; piece < kPieces; ++piece) {
      node_support += supports[piece];
      shared_right += sides[piece];
    }
  }
};

void GroundFieldOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (!good) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) +
                                  ", expected " + expected);
    }
  };
  require(column_spacing_px > 0, "column_spacing_px", column_spacing_px, "> 0");
  require(row_spacing_px > 0, "row_spacing_px", row_spacing_px, "> 0");
  require(along_curvature > 0, "along_curvature", along_curvature, "> 0");
  require(across_curvature > 0, "across_curvature", across_curvature, "> 0");
  require(metres_per_baseline > 0, "metres_per_baseline", metres_per_baseline, "> 0");
  require(correlation >= 1, "correlation", correlation, ">= 1");
  require(iterations >= 1, "iterations", iterations, ">= 1");
}

GroundField::GroundField(const PinholeCamera& camera, const GroundObservations& observations,
                         const Plane& start, const GroundFieldOptions& options)
    : impl_(std::make_unique<Impl>()) {
  options.validate();
  Impl& m = *impl_;
  m.camera = camera;
  m.options = options;
  if (observations.size() < 3) {
    throw std::invalid_argument("ground observations: " + std::to_string(observations.size()) +
                                " points, expected at least 3");
  }
  double highest = camera.height - 1.0;
  for (const Eigen::Vector2d& p : observations.pixels) highest = std::min(highest, p.y());
  m.du = options.column_spacing_px;
  m.dv = options.row_spacing_px;
  m.left = 0.0;
  m.top = highest - m.dv;
  m.columns = std::max(3, static_cast<int>(std::ceil((camera.width - 1) / m.du)) + 1);
  m.rows = std::max(4, static_cast<int>(std::ceil((camera.height - 1 - m.top) / m.dv)) + 1);
  m.nodes.resize(m.columns * m.rows);
  const Eigen::Vector3d inverse_plane = -start.normal / start.offset;
  for (int r = 0; r < m.rows; ++r) {
    for (int c = 0; c < m.columns; ++c) {
      m.nodes[m.index(r, c)] =
          inverse_plane.dot(camera.ray(Eigen::Vector2d(m.left + c * m.du, m.top + r * m.dv)));
    }
  }
  m.make_differences();

  // Weights of the first rounds: the height of an observation over the start plane against what a
  // bending road may reach there.
  const double height = std::abs(start.offset);
  std::vector<double> weight(observations.size());
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const double rho = observations.inverse_depth[i];
    const double expected = inverse_plane.dot(camera.ray(observations.pixels[i]));
    const double off = (rho - expected) / std::max(rho, 1e-9) * height;  // above, in units
    const double depth = 1.0 / std::max(rho, 1e-9);
    const double allowed = 0.1 * height + 0.12 * std::max(0.0, depth - 4.0 * height);
    weight[i] = rho > 0 ? 1.0 / std::pow(1.0 + off * off / (allowed * allowed), 2) : 0.0;
  }
  m.solve(observations, std::move(weight), options.iterations, 8.0, options.correlation);
}

void GroundField::update(const GroundObservations& observations, int iterations,
                         double correlation) {
  if (observations.size() < 3) {
    throw std::invalid_argument("ground observations: " + std::to_string(observations.size()) +
                                " points, expected at least 3");
  }
  impl_->solve(observations, {}, iterations, 1.0,
               correlation > 0 ? correlation : impl_->options.correlation);
}

Eigen::VectorXd GroundField::update_with_shared(const GroundObservations& observations,
                                                int iterations, double correlation,
                                                const Eigen::MatrixXd& information,
                                                const Eigen::VectorXd& moved,
                                                Eigen::MatrixXd* covariance) {
  const Eigen::Index columns = observations.shared_jacobian.cols();
  if (information.rows() != columns || information.cols() != columns || moved.size() != columns) {
    throw std::invalid_argument("information is " + std::to_string(information.rows()) + " x " +
                                std::to_string(information.cols()) + ", expected " +
                                std::to_string(columns) + " square");
  }
  update(observations, iterations, correlation);
  Impl& m = *impl_;
  // Observations rho_i + D_i p against b_i . x with x = x0 + S p: the nodes are eliminated,
  // sum w D' (D - b S) = sum w D' D - (sum w b' D)' S.
  std::array<Eigen::MatrixXd, Impl::kPieces> own;
  std::array<Eigen::VectorXd, Impl::kPieces> gradients;
  m.in_pieces(observations.size(), [&](std::size_t piece, std::size_t first, std::size_t last) {
    constexpr std::size_t kRows = 256;
    own[piece].setZero(columns, columns);
    gradients[piece].setZero(columns);
    Eigen::MatrixXd rows(columns, kRows);
    Eigen::VectorXd residuals(kRows);
    for (std::size_t at = first; at < last; at += kRows) {
      const std::size_t count = std::min(kRows, last - at);
      for (std::size_t k = 0; k < count; ++k) {
        const std::size_t i = at + k;
        const double root = std::sqrt(m.weights[i] / m.last_correlation) / observations.sigma[i];
        rows.col(static_cast<Eigen::Index>(k)) =
            root * observations.shared_jacobian.row(static_cast<Eigen::Index>(i))
                       .cast<double>()
                       .transpose();
        residuals[static_cast<Eigen::Index>(k)] =
            root *
            (observations.inverse_depth[i] - m.value(m.footprint(observations.pixels[i]), m.nodes));
      }
      const auto used = rows.leftCols(static_cast<Eigen::Index>(count));
      own[piece] += detail::square(used);
      gradients[piece].noalias() += used * residuals.head(static_cast<Eigen::Index>(count));
    }
  });
  Eigen::MatrixXd reduced = information;
  Eigen::VectorXd gradient = information * moved;
  for (std::size_t piece = 0; piece < Impl::kPieces; ++piece) {
    reduced += own[piece];
    gradient += gradients[piece];
  }
  reduced.noalias() -= m.shared_right.transpose() * m.shared_jacobian();
  reduced = 0.5 * (reduced + reduced.transpose()).eval();
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(reduced);
  const Eigen::VectorXd change = -ldlt.solve(gradient);
  m.nodes += m.shared_jacobian() * change;
  if (covariance) *covariance = ldlt.solve(Eigen::MatrixXd::Identity(columns, columns));
  return change;
}

GroundField::GroundField(const GroundField& other) : impl_(std::make_unique<Impl>()) {
  // All but the factorisation, which the next update replaces.
  const Impl& from = *other.impl_;
  impl_->camera = from.camera;
  impl_->left = from.left;
  impl_->top = from.top;
  impl_->du = from.du;
  impl_->dv = from.dv;
  impl_->columns = from.columns;
  impl_->rows = from.rows;
  impl_->nodes = from.nodes;
  impl_->node_support = from.node_support;
  impl_->differences = from.differences;
  impl_->options = from.options;
}

GroundField::~GroundField() = default;
GroundField::GroundField(GroundField&&) noexcept = default;
GroundField& GroundField::operator=(GroundField&&) noexcept = default;

double GroundField::inverse_depth(const Eigen::Vector2d& pixel) const {
  return impl_->value(impl_->footprint(pixel), impl_->nodes);
}

double GroundField::observed(const Eigen::Vector2d& pixel) const {
  return impl_->value(impl_->footprint(pixel), impl_->node_support);
}

double GroundField::top() const { return impl_->top; }

double GroundField::interpolated(const Eigen::Vector2d& pixel,
                                 const Eigen::VectorXd& node_values) const {
  return impl_->value(impl_->footprint(pixel), node_values);
}

void GroundField::interpolated_row(double row, const Eigen::VectorXd& node_values, int count,
                                   float* out) const {
  const Impl& m = *impl_;
  const Footprint first = m.footprint({m.left, row});
  const double below = first.weight[2] + first.weight[3];
  for (int c = 0, u = 0; c + 1 < m.columns && u < count; ++c) {
    const double a =
        (1.0 - below) * node_values[first.node[0] + c] + below * node_values[first.node[2] + c];
    const double b = (1.0 - below) * node_values[first.node[0] + c + 1] +
                     below * node_values[first.node[2] + c + 1];
    const double slope = (b - a) / m.du, at = m.left + c * m.du;
    const int end =
        c + 2 == m.columns ? count : std::min(count, static_cast<int>(std::ceil(at + m.du)));
    for (; u < end; ++u) {
      out[u] = static_cast<float>(a + slope * std::clamp(u - at, 0.0, m.du));
    }
  }
}

const Eigen::VectorXd& GroundField::nodes() const { return impl_->nodes; }

const Eigen::MatrixXd& GroundField::shared() const { return impl_->shared_jacobian(); }

Eigen::MatrixXd GroundField::functionals(const std::vector<Eigen::Vector2d>& pixels,
                                         const Eigen::MatrixXd& coefficients) const {
  return impl_->functional(pixels, coefficients);
}

Eigen::MatrixXd GroundField::solve(const Eigen::MatrixXd& of_nodes) const {
  constexpr Eigen::Index kPiece = 16;  // columns
  const Impl& m = *impl_;
  {
    const std::lock_guard<std::mutex> lock(m.posterior_mutex);
    if (!m.posterior) m.posterior.emplace(m.normal);
  }
  if (of_nodes.cols() <= kPiece) return m.posterior->solve(of_nodes);
  Eigen::MatrixXd out(of_nodes.rows(), of_nodes.cols());
  const Eigen::Index pieces = (of_nodes.cols() + kPiece - 1) / kPiece;
  parallel_for(static_cast<std::size_t>(pieces), m.options.num_threads, [&](std::size_t k) {
    const Eigen::Index first = kPiece * static_cast<Eigen::Index>(k);
    const Eigen::Index count = std::min(kPiece, of_nodes.cols() - first);
    out.middleCols(first, count) = m.posterior->solve(of_nodes.middleCols(first, count));
  });
  return out;
}

Eigen::MatrixXd GroundField::covariance(const std::vector<Eigen::Vector2d>& pixels,
                                        const Eigen::MatrixXd& coefficients,
                                        const Eigen::MatrixXd& shared_covariance) const {
  const Eigen::MatrixXd of_nodes = functionals(pixels, coefficients);
  Eigen::MatrixXd out = of_nodes.transpose() * solve(of_nodes);
  if (shared_covariance.size() > 0 && shared().size() > 0) {
    const Eigen::MatrixXd j = of_nodes.transpose() * shared();
    out += j * shared_covariance * j.transpose();
  }
  return 0.5 * (out + out.transpose());
}

const std::vector<double>& GroundField::weights() const { return impl_->weights; }

}  // namespace camber
