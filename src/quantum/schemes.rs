//! The schemes that are taken on a quantum computer in place of the case's own.
//!
//! With degree 0 it is the conservative interface, because it needs no weights ([`scheme_of`]).
//! Weights are a table as large as phase space, which a query cannot compute. Where the flow can be
//! unitary, that scheme is compared with it ([`unitary_of`]).

use crate::base::error::{Error, Result};
use crate::problem::case::{Case, EndFlux, Interface, Limiter, Method, SchemeSettings};
use crate::scheme::interface::law_of;

/// `case` with the scheme that is taken on a quantum computer: in place of an interface law that
/// needs weights the conservative one, which is stable without them.
pub fn scheme_of(case: &Case) -> Case {
    let mut case = case.clone();
    if law_of(case.scheme.interface).may_grow() {
        (case.scheme.interface, case.warp.weights) = (Interface::Conservative, false);
    }
    case
}

/// `case` with the scheme whose flow is unitary: the central flux and closed ends.
///
/// # Errors
/// [`Error::Input`] where something enters or is reflected in part: then there is none.
pub fn unitary_of(case: &Case) -> Result<Case> {
    let wrong = |what: &str| Err(Error::Input(format!("{}: {what}", case.name)));
    if case.embeds() {
        return wrong("something enters (inflow.value), and the norm is not kept");
    }
    if case.reflects() {
        return wrong("potential.reflection mixes two traces into two, and is no isometry");
    }
    Ok(with_unitary_scheme(case))
}

/// `case` with that scheme, which is unitary if nothing enters or is reflected in part.
pub fn with_unitary_scheme(case: &Case) -> Case {
    let mut case = case.clone();
    case.scheme = SchemeSettings {
        interface: Interface::Conservative,
        flux: 0.0,
        ends: EndFlux::Closed,
        limiter: Limiter::None,
        ..case.scheme
    };
    (case.method, case.warp.weights) = (Method::Schrodingerized, false);
    case
}
