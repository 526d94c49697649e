# Decides whether the CUDA backend is built, finds nvcc and enables the language. Sets DST_HAS_CUDA.
#
# nvcc is looked for in CUDACXX, on PATH, in the usual toolkit place, and in Python's `nvidia` packages: the toolkit as PyPI
# ships it, which the build back end (tools/build_backend.py) asks for when the machine has none.
set(DST_HAS_CUDA OFF)

set(dst_cuda_wish "${DST_CUDA}")
if(dst_cuda_wish STREQUAL "AUTO" AND DEFINED ENV{DESTELLO_CUDA})
  if("$ENV{DESTELLO_CUDA}" MATCHES "^(0|OFF|FALSE|NO|off|false|no)$")
    set(dst_cuda_wish OFF)
  elseif("$ENV{DESTELLO_CUDA}" MATCHES "^(1|ON|TRUE|YES|on|true|yes)$")
    set(dst_cuda_wish ON)
  endif()
endif()
if(NOT dst_cuda_wish STREQUAL "AUTO" AND NOT dst_cuda_wish)
  message(STATUS "destello: CUDA backend off, as asked")
  return()
endif()

function(dst_find_nvcc result)
  if(DEFINED ENV{CUDACXX})
    set(${result} "$ENV{CUDACXX}" PARENT_SCOPE)
    return()
  endif()
  find_program(nvcc NAMES nvcc PATHS /usr/local/cuda/bin NO_CACHE)
  if(NOT nvcc)
    execute_process(
      COMMAND "${Python_EXECUTABLE}" -c "import nvidia; print(';'.join(nvidia.__path__))"
      OUTPUT_VARIABLE roots OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    foreach(root IN LISTS roots)
      file(GLOB places "${root}/cu1*/bin/nvcc")
      if(places)
        list(SORT places COMPARE NATURAL ORDER DESCENDING)
        list(GET places 0 nvcc)
        break()
      endif()
    endforeach()
  endif()
  set(${result} "${nvcc}" PARENT_SCOPE)
endfunction()

# An isolated build leaves a path into a folder that is gone by the next build of the same tree: look again then.
if(CMAKE_CUDA_COMPILER AND NOT EXISTS "${CMAKE_CUDA_COMPILER}")
  unset(CMAKE_CUDA_COMPILER CACHE)
  file(REMOVE "${CMAKE_BINARY_DIR}/CMakeFiles/${CMAKE_VERSION}/CMakeCUDACompiler.cmake")
endif()
if(NOT CMAKE_CUDA_COMPILER)
  dst_find_nvcc(found_nvcc)
  if(NOT found_nvcc)
    set(advice "Set CUDACXX, put nvcc on PATH, or `pip install 'cuda-toolkit[nvcc,cudart,cccl]==13.0.*'` (pip does so by itself in an isolated build).")
    if(NOT dst_cuda_wish STREQUAL "AUTO")
      message(FATAL_ERROR "destello: DST_CUDA=${DST_CUDA} asks for the CUDA backend, but there is no nvcc. ${advice}")
    endif()
    message(WARNING "destello: no nvcc found: this build can render on the CPU only. ${advice}")
    return()
  endif()
  set(CMAKE_CUDA_COMPILER "${found_nvcc}")
endif()

# The PyPI packages keep their libraries in lib, where nvcc's own profile says lib64: without this nothing links.
cmake_path(GET CMAKE_CUDA_COMPILER PARENT_PATH cuda_root)
cmake_path(GET cuda_root PARENT_PATH cuda_root)
if(EXISTS "${cuda_root}/lib/libcudart_static.a" AND NOT CMAKE_CUDA_FLAGS MATCHES "-L${cuda_root}/lib( |$)")
  string(APPEND CMAKE_CUDA_FLAGS " -L${cuda_root}/lib")
endif()

# The machine's own GPU when there is one; else code for Ampere (also Ada) and Hopper, and PTX that every newer or older GPU
# from Turing on compiles at its first use.
if(NOT DEFINED CMAKE_CUDA_ARCHITECTURES AND NOT DEFINED ENV{CUDAARCHS})
  execute_process(COMMAND nvidia-smi -L OUTPUT_VARIABLE gpus RESULT_VARIABLE no_smi ERROR_QUIET)
  if(no_smi EQUAL 0 AND gpus MATCHES "GPU 0")
    set(CMAKE_CUDA_ARCHITECTURES native)
  else()
    set(CMAKE_CUDA_ARCHITECTURES 75-virtual 80-real 90-real)
  endif()
endif()

set(CMAKE_CUDA_RUNTIME_LIBRARY Static)
enable_language(CUDA)
set(DST_HAS_CUDA ON)
message(STATUS "destello: CUDA backend on, ${CMAKE_CUDA_COMPILER} ${CMAKE_CUDA_COMPILER_VERSION} for ${CMAKE_CUDA_ARCHITECTURES}")
