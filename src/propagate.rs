//! Propagation of mode batches, `w_l(T) = exp(−iH_l T) w(0)`, `H_l = μ_l S + iK`.

pub mod chebyshev;
