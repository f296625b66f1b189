pub(crate) fn run(_json: bool) -> Result<(), crate::Failure> {
    Ok(())
}
