cdef extern from *:
    """
    #if defined(__AVX__)
    #include <immintrin.h>
    #define LANES 4
    #else
    #define LANES 2
    #endif
    typedef double lanes __attribute__((vector_size(8 * LANES), aligned(8)));
    #define zero_lanes() ((lanes){0.0})

    static inline void transpose_block(const double *from, double *to, Py_ssize_t stride)
    {
        const lanes *a = (const lanes *) from, *b = (const lanes *) (from + stride);
    #if LANES == 4
        const lanes *c = (const lanes *) (from + 2 * stride), *d = (const lanes *) (from + 3 * stride);
        __m256d ab_0 = _mm256_unpacklo_pd(*a, *b), ab_1 = _mm256_unpackhi_pd(*a, *b);
        __m256d cd_0 = _mm256_unpacklo_pd(*c, *d), cd_1 = _mm256_unpackhi_pd(*c, *d);
        *(lanes *) to = _mm256_permute2f128_pd(ab_0, cd_0, 0x20);
        *(lanes *) (to + stride) = _mm256_permute2f128_pd(ab_1, cd_1, 0x20);
        *(lanes *) (to + 2 * stride) = _mm256_permute2f128_pd(ab_0, cd_0, 0x31);
        *(lanes *) (to + 3 * stride) = _mm256_permute2f128_pd(ab_1, cd_1, 0x31);
    #else
        lanes first = {(*a)[0], (*b)[0]}, second = {(*a)[1], (*b)[1]};
        *(lanes *) to = first;
        *(lanes *) (to + stride) = second;
    #endif
    }
    """
    ctypedef double lanes
    enum: LANES
    lanes zero_lanes() noexcept nogil
    void transpose_block(double *source, double *target, Py_ssize_t stride) noexcept nogil


cdef inline Py_ssize_t registers(Py_ssize_t count) noexcept nogil:
    return (count + LANES - 1) // LANES


cdef inline lanes load(double[:, ::1] A, Py_ssize_t a, Py_ssize_t q) noexcept nogil:
    return (<lanes *> &A[a, q * LANES])[0]


cdef inline lanes load_of(double[:, :, ::1] A, Py_ssize_t d, Py_ssize_t a, Py_ssize_t q) noexcept nogil:
    return (<lanes *> &A[d, a, q * LANES])[0]


cdef inline lanes load_at(double[::1] A, Py_ssize_t q) noexcept nogil:
    return (<lanes *> &A[q * LANES])[0]


cdef inline void store(double[:, ::1] A, Py_ssize_t a, Py_ssize_t q, lanes value) noexcept nogil:
    (<lanes *> &A[a, q * LANES])[0] = value


cdef inline void store_at(double[::1] A, Py_ssize_t q, lanes value) noexcept nogil:
    (<lanes *> &A[q * LANES])[0] = value


cdef inline void mirror_block(double[:, ::1] A, Py_ssize_t p, Py_ssize_t q) noexcept nogil:
    transpose_block(&A[p * LANES, q * LANES], &A[q * LANES, p * LANES], A.shape[1])
