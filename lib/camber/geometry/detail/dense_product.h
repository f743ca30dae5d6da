#pragma once

#include <Eigen/Core>

namespace camber::detail {

// Products of dense matrices in four lanes where the processor has them, which Eigen, compiled for
// any x86-64, does in two.

/// a * b
Eigen::MatrixXd product(const Eigen::Ref<const Eigen::MatrixXd>& a,
                        const Eigen::Ref<const Eigen::MatrixXd>& b);

/// a' * b
Eigen::MatrixXd transposed_product(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                   const Eigen::Ref<const Eigen::MatrixXd>& b);

/// a * a', of which one triangle is computed.
Eigen::MatrixXd square(const Eigen::Ref<const Eigen::MatrixXd>& a);

}  // namespace camber::detail
