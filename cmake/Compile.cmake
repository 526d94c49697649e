# dst_compile_options(target): how destello's own C++ and CUDA code is compiled.
#
# `#pragma unroll` is for nvcc alone, so unknown pragmas pass.
#
# Device code divides and takes roots to within 2 ulp instead of correctly rounded, which takes a fraction of the
# instructions; error bounds (core/base/ray.h) have that to spare.
#
# Results must not depend on the compiler's mood: no contraction into fused multiply-adds on the host. The two -fno- options
# keep every result bit and only drop errno and trap bookkeeping, which would stop vectorisation.
function(dst_compile_options target)
  set(fp -ffp-contract=off -fno-math-errno -fno-trapping-math)
  set(werror $<$<BOOL:${DST_WERROR}>:-Werror>)
  target_compile_options(${target} PRIVATE $<$<COMPILE_LANGUAGE:CXX>:-O3 -Wall -Wextra -Wno-psabi -Wno-unknown-pragmas ${werror} ${fp}>)
  if(DST_HAS_CUDA)
    list(JOIN fp "," fp_list)
    set_target_properties(${target} PROPERTIES
      CUDA_STANDARD 20 CUDA_STANDARD_REQUIRED ON CUDA_EXTENSIONS OFF CUDA_VISIBILITY_PRESET hidden)
    target_compile_options(${target} PRIVATE
      $<$<COMPILE_LANGUAGE:CUDA>:--expt-relaxed-constexpr -lineinfo --threads=2 --prec-div=false --prec-sqrt=false --ftz=true -Xfatbin=-compress-all
      -Xcompiler=-Wall,-Wno-psabi,-Wno-unknown-pragmas,${fp_list}>
      $<$<AND:$<COMPILE_LANGUAGE:CUDA>,$<BOOL:${DST_WERROR}>>:-Werror=all-warnings>)
  endif()
  if(DST_SANITIZE)
    set(flags -fsanitize=${DST_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer -g)
    # Asserts are on.
    target_compile_options(${target} PRIVATE $<$<COMPILE_LANGUAGE:CXX>:${flags} -O1 -UNDEBUG>)
    target_link_options(${target} PUBLIC ${flags})
  endif()
endfunction()
