// What a thin film on rough facets reflects: its fringes ask for more cosines than the two of albedo.h.
#pragma once

#include "bsdf/openpbr/albedo.h"
#include "bsdf/openpbr/thin_film.h"

namespace destello::openpbr {

// The coordinate of a direction: `place`, spread out where facets are seen from above and sideways tilts count.
DST_FN float strata_place(float cosine, float roughness) { return 1.0f - safe_sqrt(1.0f - place(cosine, roughness)); }

// Facets by the cosine at which they are seen, in N strata: the mean in each, and its share of them.
template <int N>
struct Strata {
  float c[N];

  DST_HD static float share(int i) {
    constexpr int n = kMeanStrata / N;
    float sum = 0;
    for (int k = 0; k < n; ++k) sum += stratum_share(i * n + k);
    return sum;
  }
  // The mean of what they reflect. Each stratum counts as evenly filled, up to halfway to the next one's mean.
  DST_HD Vec3 reflected(const ThinFilm& film, float eta) const {
    Vec3 sum;
    float from = film.inside(max(1.5f * c[0] - 0.5f * c[1], 0.0f));
    for (int i = 0; i < N; ++i) {
      const float to = film.inside(i + 1 < N ? 0.5f * (c[i] + c[i + 1]) : min(1.5f * c[i] - 0.5f * c[i - 1], 1.0f));
      sum += film.dielectric(c[i], eta, to - from) * share(i);
      from = to;
    }
    return sum;
  }
};
template <int N, int A, class Entry>
DST_FN Strata<N> look_up_strata(const Between (&at)[A], const int (&sizes)[A], float seen, const Entry& entry) {
  Strata<N> s{};
  corners(at, sizes, [&](int i, float w) {
    const CosineEntry<N> e = entry(i);
    for (int k = 0; k < N; ++k) s.c[k] += w * static_cast<float>(e.c[k]);
  });
  for (float& c : s.c) c = min(seen * c / (65535.0f - c), 1.0f);
  return s;
}

// Of light from w, w.z >= 0, by facets that lose none.
DST_FN DST_COLD Vec3 reflected_by_film(const ThinFilm& film, float eta, Vec3 w, Ggx g) {
  if (g.smooth()) return film.dielectric(w.z, eta);
  const float r = mean_roughness(g);
  if (g.ax == g.ay) {
    const Between at[] = {{strata_place(w.z, r), kStrataCosines}, {r, kStrataRoughnesses}};
    return look_up_strata<kStrata>(at, {kStrataCosines, kStrataRoughnesses}, seen_cosine(w.z, g.ax),
                                   [](int i) { return strata_entry(i); })
        .reflected(film, eta);
  }
  const Along a(w, g);
  const Between at[] = {{strata_place(w.z, sqrtf(a.alpha)), kStretchedStrataCosines},
                        {a.turn, kStrataTurns},
                        stretch(g, kStrataStretches),
                        {r, kStretchedStrataRoughnesses}};
  return look_up_strata<kStrata>(at,
                                 {kStretchedStrataCosines, kStrataTurns, kStrataStretches, kStretchedStrataRoughnesses},
                                 seen_cosine(w.z, a.alpha), [](int i) { return stretched_strata_entry(i); })
      .reflected(film, eta);
}
// The mean over cosine-distributed directions, each by the share that its facets do not lose.
DST_FN DST_COLD Vec3 mean_reflected_by_film(const ThinFilm& film, float eta, Ggx g) {
  const float r = mean_roughness(g);
  if (g.ax == g.ay) {
    const Between at[] = {{r, kStrataRoughnesses}};
    return look_up_strata<kMeanStrata>(at, {kStrataRoughnesses}, 1, [](int i) { return mean_strata_entry(i); })
        .reflected(film, eta);
  }
  const Between at[] = {stretch(g, kStrataStretches), {r, kStretchedStrataMeanRoughnesses}};
  return look_up_strata<kMeanStrata>(at, {kStrataStretches, kStretchedStrataMeanRoughnesses}, 1,
                                     [](int i) { return stretched_mean_strata_entry(i); })
      .reflected(film, eta);
}

}  // namespace destello::openpbr
