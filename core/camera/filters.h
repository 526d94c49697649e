// The list of reconstruction filters; the first is the default.
#pragma once

#include "base/one_of.h"
#include "camera/blackman_harris_filter.h"
#include "camera/box_filter.h"
#include "camera/gaussian_filter.h"
#include "camera/mitchell_filter.h"
#include "camera/tent_filter.h"

namespace destello {

using Filters = TypeList<GaussianFilter, BoxFilter, TentFilter, MitchellFilter, BlackmanHarrisFilter>;

// Any filter of the list.
using AnyFilter = OneOfT<Filters>;

template <class... F>
constexpr bool all_filters(TypeList<F...>) {
  return (Filter<F> && ...);
}
static_assert(all_filters(Filters{}));

}  // namespace destello
